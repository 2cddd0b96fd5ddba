# The files that `cmake --install` installs, and their places. Components: programs, cad, library, development, python, services, documentation, benchmarks.
include(${CMAKE_CURRENT_LIST_DIR}/man_pages.cmake)
set(PACKAGES ${CMAKE_CURRENT_LIST_DIR})

install(TARGETS quarry quarry-master quarry-worker quarry-preprocess quarry-scene
        RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT programs)
install(TARGETS quarry-import-image RUNTIME DESTINATION ${QUARRY_LIBEXEC} COMPONENT programs)
foreach(helper quarry-import-assimp quarry-import-draco)
  if(TARGET ${helper})
    install(TARGETS ${helper} RUNTIME DESTINATION ${QUARRY_LIBEXEC} COMPONENT programs)
  endif()
endforeach()
if(TARGET quarry-import-cad)
  install(TARGETS quarry-import-cad RUNTIME DESTINATION ${QUARRY_LIBEXEC} COMPONENT cad)
endif()

# libquarry, for programs: the library, what compilers need, and the Python package. pkg-config and CMake find it by files that may be moved with it.
include(CMakePackageConfigHelpers)
set(API ${CMAKE_SOURCE_DIR}/common/api)
set(QUARRY_CMAKE_DIR ${CMAKE_INSTALL_LIBDIR}/cmake/Quarry)
file(RELATIVE_PATH PC_TO_PREFIX /prefix/${CMAKE_INSTALL_LIBDIR}/pkgconfig /prefix)
configure_file(${API}/quarry.pc.in ${CMAKE_BINARY_DIR}/api/quarry.pc @ONLY)
write_basic_package_version_file(${CMAKE_BINARY_DIR}/api/QuarryConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(TARGETS quarry_shared EXPORT QuarryTargets LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT library NAMELINK_COMPONENT development)
install(EXPORT QuarryTargets FILE QuarryConfig.cmake NAMESPACE Quarry:: DESTINATION ${QUARRY_CMAKE_DIR} COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/api/QuarryConfigVersion.cmake DESTINATION ${QUARRY_CMAKE_DIR} COMPONENT development)
install(FILES ${CMAKE_BINARY_DIR}/api/quarry.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig COMPONENT development)
install(FILES ${API}/quarry.h ${API}/quarry.hpp DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT development)
install(FILES ${API}/examples/sight.c DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/libquarry-dev/examples COMPONENT development)
install(DIRECTORY ${API}/python/quarry DESTINATION lib/python3/dist-packages COMPONENT python PATTERN __pycache__ EXCLUDE)
install(DIRECTORY ${API}/python/examples/ DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/doc/python3-quarry/examples COMPONENT python PATTERN __pycache__ EXCLUDE)

# bash-completion looks for a file by the name of the command.
set(COMPLETIONS ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(FILES ${PACKAGES}/completion.bash DESTINATION ${COMPLETIONS} RENAME quarry COMPONENT programs)
foreach(program quarry-master quarry-worker quarry-preprocess quarry-scene)
  install(CODE "execute_process(COMMAND ${CMAKE_COMMAND} -E create_symlink quarry \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/${COMPLETIONS}/${program}\")"
          COMPONENT programs)
endforeach()

install(CODE "set(SYSTEMD_SOURCES ${CMAKE_SOURCE_DIR}/deploy/systemd)
set(BINDIR ${CMAKE_INSTALL_BINDIR})" COMPONENT services)
install(SCRIPT ${CMAKE_SOURCE_DIR}/deploy/systemd/install.cmake COMPONENT services)

# The folders of the sources, so that the pages' links to each other lead somewhere.
foreach(page README.md deploy/README.md deploy/MANUAL.md deploy/RAYS.md deploy/FILES.md deploy/LIBRARIES.md deploy/LIVE_VIEW.md deploy/PICTURES.md deploy/SOURCES.md deploy/packages/README.md
        deploy/systemd/README.md preprocess/README.md preprocess/import/README.md preprocess/import/cad/README.md preprocess/import/gltf/README.md preprocess/import/threemf/README.md)
  get_filename_component(folder ${page} DIRECTORY)
  install(FILES ${CMAKE_SOURCE_DIR}/${page} DESTINATION ${CMAKE_INSTALL_DOCDIR}/${folder} COMPONENT documentation)
endforeach()
install(DIRECTORY ${CMAKE_SOURCE_DIR}/deploy/container ${CMAKE_SOURCE_DIR}/deploy/slurm DESTINATION ${CMAKE_INSTALL_DOCDIR}/deploy COMPONENT documentation)

foreach(bench connection frames images import kernels loading plan rays simulate sources stores stream)
  if(TARGET quarry-bench-${bench})
    install(TARGETS quarry-bench-${bench} RUNTIME DESTINATION ${QUARRY_LIBEXEC} COMPONENT benchmarks)
  endif()
endforeach()
if(TARGET quarry-packaged-bench-papers)
  install(TARGETS quarry-packaged-bench-papers RUNTIME DESTINATION ${QUARRY_LIBEXEC} COMPONENT benchmarks)
endif()

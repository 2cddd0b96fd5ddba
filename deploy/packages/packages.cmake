# Debian packages: `cpack --config build/release/CPackConfig.cmake -B build/release`. quarry has the programs, quarry-cad the reader of STEP and IGES with its large library, libquarry0, libquarry-dev and python3-quarry the rays for other programs, quarry-bench the benchmarks, if they are built (with the tests).
# The packages' maintainer is the person named by DEBFULLNAME and DEBEMAIL, as for Debian's own tools.
set(packer "Quarry maintainers <maintainers@localhost>")
if(DEFINED ENV{DEBFULLNAME} AND DEFINED ENV{DEBEMAIL})
  set(packer "$ENV{DEBFULLNAME} <$ENV{DEBEMAIL}>")
endif()
set(QUARRY_MAINTAINER "${packer}" CACHE STRING "Maintainer field of the packages")
set(QUARRY_DEBIAN_REVISION 1 CACHE STRING "Revision of the packages, after the release")
set(DEBIAN ${CMAKE_CURRENT_LIST_DIR}/debian)
set(DEBIAN_MADE ${CMAKE_BINARY_DIR}/debian)

string(TIMESTAMP DEBIAN_DATE "%a, %d %b %Y %H:%M:%S +0000" UTC)
configure_file(${DEBIAN}/changelog.in ${DEBIAN_MADE}/changelog @ONLY)
find_program(GZIP gzip REQUIRED)
execute_process(COMMAND ${GZIP} -9nc ${DEBIAN_MADE}/changelog OUTPUT_FILE ${DEBIAN_MADE}/changelog.Debian.gz COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND ${GZIP} -9nc ${CMAKE_SOURCE_DIR}/CHANGELOG.md OUTPUT_FILE ${DEBIAN_MADE}/changelog.gz COMMAND_ERROR_IS_FATAL ANY)
set(component_of_quarry documentation)
set(component_of_quarry-bench benchmarks)
set(component_of_quarry-cad cad)
set(component_of_libquarry0 library)
set(component_of_libquarry-dev development)
set(component_of_python3-quarry python)
foreach(package quarry quarry-bench quarry-cad libquarry0 libquarry-dev python3-quarry)
  set(component ${component_of_${package}})
  set(docs ${CMAKE_INSTALL_DATAROOTDIR}/doc/${package})
  install(FILES ${DEBIAN}/copyright ${DEBIAN_MADE}/changelog.Debian.gz ${DEBIAN_MADE}/changelog.gz DESTINATION ${docs} COMPONENT ${component})
  if(EXISTS ${DEBIAN}/${package}.overrides)
    install(FILES ${DEBIAN}/${package}.overrides DESTINATION ${CMAKE_INSTALL_DATAROOTDIR}/lintian/overrides RENAME ${package} COMPONENT ${component})
  endif()
endforeach()

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME quarry)
set(CPACK_PACKAGE_VENDOR Quarry)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_VERBATIM_VARIABLES ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL programs services documentation library development python)
if(TARGET quarry-bench-kernels)
  list(APPEND CPACK_COMPONENTS_ALL benchmarks)
endif()
if(TARGET quarry-import-cad)
  list(APPEND CPACK_COMPONENTS_ALL cad)
endif()
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "${QUARRY_MAINTAINER}")
set(CPACK_DEBIAN_PACKAGE_RELEASE ${QUARRY_DEBIAN_REVISION})
set(CPACK_DEBIAN_PACKAGE_SECTION graphics)
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
# Dependencies are found when packing: see dependencies.cmake.
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS OFF)
set(CPACK_PROJECT_CONFIG_FILE ${CMAKE_CURRENT_LIST_DIR}/dependencies.cmake)
set(CPACK_QUARRY_BUILD ${CMAKE_BINARY_DIR})
set(CPACK_QUARRY_BIN ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})

set(CPACK_DEBIAN_QUARRY_PACKAGE_NAME quarry)
# The summaries are in the descriptions.
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "")
set(CPACK_DEBIAN_QUARRY_DESCRIPTION "out-of-core ray tracing of triangle models, on one machine or many
Quarry ray-traces triangle models that are larger than the memory of any
machine at hand. A model is cut once, out of core, into compressed voxels;
workers fetch voxels on demand into a cache of fixed size. The same pixels
come out for any number of workers, threads and caches.
.
This package holds the commands, the master and the worker of a cluster with
their systemd units, and the preprocessor. Images of models and rare formats
are read by libraries that it recommends: machines that only render do
without.")
set(CPACK_DEBIAN_QUARRY_PACKAGE_CONTROL_EXTRA ${DEBIAN}/postinst ${DEBIAN}/prerm ${DEBIAN}/postrm ${DEBIAN}/conffiles)
set(CPACK_DEBIAN_BENCH_PACKAGE_NAME quarry-bench)
set(CPACK_DEBIAN_BENCH_DESCRIPTION "benchmarks of the Quarry ray tracer
The programs that 'quarry bench' runs: kernels against Embree, pictures,
importers, voxel sources, connections and schedules.")
set(CPACK_DEBIAN_CAD_PACKAGE_NAME quarry-cad)
set(CPACK_DEBIAN_CAD_DESCRIPTION "STEP and IGES for the Quarry ray tracer
The program by which quarry-preprocess makes triangles of exact surfaces.
It links Open CASCADE, 390 MB with what it needs, which machines that
only render do without.")
set(CPACK_DEBIAN_LIBRARY_PACKAGE_NAME libquarry0)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_LIBRARY_PACKAGE_CONTROL_EXTRA ${DEBIAN}/triggers)
set(CPACK_DEBIAN_LIBRARY_DESCRIPTION "rays through triangle models larger than memory
The library by which programs ask Quarry's scenes for the hits of rays:
nearest, any, how many and all. Voxels are read when rays need them, into
a cache of fixed size.")
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_NAME libquarry-dev)
set(CPACK_DEBIAN_DEVELOPMENT_PACKAGE_SECTION libdevel)
set(CPACK_DEBIAN_DEVELOPMENT_DESCRIPTION "rays through triangle models larger than memory, for C and C++
Headers, the link by which compilers find libquarry, and its files for
pkg-config and CMake.")
set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-quarry)
set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
set(CPACK_DEBIAN_PYTHON_PACKAGE_ARCHITECTURE all)
set(CPACK_DEBIAN_PYTHON_DESCRIPTION "rays through triangle models larger than memory, for Python
The package quarry: scenes, and the hits of arrays of rays, by the names
and shapes of Open3D's RaycastingScene.")

include(CPack)
cpack_add_component_group(quarry)
cpack_add_component_group(bench)
cpack_add_component_group(cad)
foreach(component library development python)
  cpack_add_component_group(${component})
  cpack_add_component(${component} GROUP ${component})
endforeach()
foreach(component programs services documentation)
  cpack_add_component(${component} GROUP quarry)
endforeach()
cpack_add_component(benchmarks GROUP bench)
cpack_add_component(cad GROUP cad)

# Man pages, made by help2man from each --help. Without help2man there are none.
find_program(HELP2MAN help2man)
if(NOT HELP2MAN)
  message(STATUS "help2man not found: man pages are not made; deploy/install installs it")
  return()
endif()
set(MAN_DIR ${CMAKE_BINARY_DIR}/man)
# The date in the pages is that of the sources, where it is known: the same sources give the same pages.
set(MAN_EPOCH "")
if(QUARRY_REVISION)
  execute_process(COMMAND ${GIT_EXECUTABLE} -C ${CMAKE_SOURCE_DIR} log -1 --format=%ct OUTPUT_VARIABLE MAN_EPOCH OUTPUT_STRIP_TRAILING_WHITESPACE)
endif()
set(MAN_SCRIPT ${CMAKE_CURRENT_LIST_DIR}/man_page)
set(MAN_SECTIONS ${CMAKE_CURRENT_LIST_DIR}/man_sections)

# One page: its name, the program or the program with a command, and the words after the dash in NAME.
function(add_man_page name program command words)
  add_custom_command(OUTPUT ${MAN_DIR}/${name}.1.gz
    COMMAND ${CMAKE_COMMAND} -E env SOURCE_DATE_EPOCH=${MAN_EPOCH} ${MAN_SCRIPT} ${name} $<TARGET_FILE:${program}> "${command}" "${words}"
            ${PROJECT_VERSION} ${MAN_SECTIONS} ${MAN_DIR}/${name}.1.gz
    DEPENDS ${program} ${MAN_SCRIPT} ${MAN_SECTIONS} VERBATIM)
  set_property(DIRECTORY APPEND PROPERTY MAN_PAGES ${MAN_DIR}/${name}.1.gz)
endfunction()

add_man_page(quarry quarry "" "ray-trace triangle models that are larger than memory")
add_man_page(quarry-render quarry render "render pictures of a scene or a model")
add_man_page(quarry-view quarry view "walk through a scene, live, in a browser")
add_man_page(quarry-info quarry info "describe the contents of a scene store")
add_man_page(quarry-rays quarry rays "answer rays: hits, shade, counts")
add_man_page(quarry-verify quarry verify "check every byte of a scene store")
add_man_page(quarry-status quarry status "show a cluster's workers, jobs and rates")
add_man_page(quarry-cache quarry cache "list, make, limit or clear the kept stores of models")
add_man_page(quarry-cluster quarry cluster "start a cluster on machines that Slurm gives, or end it")
add_man_page(quarry-bench quarry bench "run a benchmark program")
add_man_page(quarry-master quarry-master "" "schedule tiles, serve voxels and assemble frames")
add_man_page(quarry-worker quarry-worker "" "render tiles for a master")
add_man_page(quarry-preprocess quarry-preprocess "" "cut models into a scene store, out of core")
add_man_page(quarry-scene quarry-scene "" "write procedural scenes of any size")

get_property(MAN_PAGES DIRECTORY PROPERTY MAN_PAGES)
# Builds for sanitizers and fuzzers need no pages.
if(NOT QUARRY_SANITIZE AND NOT QUARRY_FUZZ)
  add_custom_target(man ALL DEPENDS ${MAN_PAGES})
  install(FILES ${MAN_PAGES} DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT programs)
endif()

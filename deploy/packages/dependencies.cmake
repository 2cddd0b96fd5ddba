# Runs when packing. dpkg-shlibdeps names the packages of the libraries that the programs link. The helpers that read images and rare formats
# link hundreds (OpenImageIO's); these are recommended, so that `apt install` brings them and machines that only render can do without.
function(shared_libraries depends recommends programs helpers)
  set(folder ${CPACK_QUARRY_BUILD}/shlibdeps)
  file(MAKE_DIRECTORY ${folder}/debian)
  file(WRITE ${folder}/debian/control "Source: quarry\nPackage: quarry\nArchitecture: any\n")
  execute_process(COMMAND dpkg-shlibdeps -O --warnings=0 -dDepends ${programs} -dRecommends ${helpers} WORKING_DIRECTORY ${folder}
                  OUTPUT_VARIABLE found COMMAND_ERROR_IS_FATAL ANY)
  if(found MATCHES "shlibs:Depends=([^\n]*)")
    set(${depends} "${CMAKE_MATCH_1}" PARENT_SCOPE)
  endif()
  if(found MATCHES "shlibs:Recommends=([^\n]*)")
    set(${recommends} "${CMAKE_MATCH_1}" PARENT_SCOPE)
  endif()
endfunction()

set(programs quarry quarry-master quarry-worker quarry-preprocess quarry-scene)
list(TRANSFORM programs PREPEND ${CPACK_QUARRY_BIN}/)
file(GLOB helpers ${CPACK_QUARRY_BIN}/quarry-import-*)
file(GLOB benches ${CPACK_QUARRY_BIN}/quarry-bench-*)
shared_libraries(CPACK_DEBIAN_QUARRY_PACKAGE_DEPENDS CPACK_DEBIAN_QUARRY_PACKAGE_RECOMMENDS "${programs}" "${helpers}")
# https sources check servers against the system's authorities.
string(APPEND CPACK_DEBIAN_QUARRY_PACKAGE_RECOMMENDS ", ca-certificates")
set(CPACK_DEBIAN_QUARRY_PACKAGE_SUGGESTS "quarry-bench, openssl, bash-completion")
if(benches)
  shared_libraries(CPACK_DEBIAN_BENCH_PACKAGE_DEPENDS unused "${benches}" "")
  string(APPEND CPACK_DEBIAN_BENCH_PACKAGE_DEPENDS ", quarry (= ${CPACK_PACKAGE_VERSION}-${CPACK_DEBIAN_PACKAGE_RELEASE})")
  set(CPACK_DEBIAN_BENCH_PACKAGE_SUGGESTS "nginx-light")
endif()

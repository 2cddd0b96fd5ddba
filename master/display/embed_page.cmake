# Writes the page's files as a C++ source. Usage: cmake -DFOLDER=... -DOUT=... -P embed_page.cmake
# A file has its name without its folder, because the server knows a file by the last part of a path: a proxy may put anything in front of it.
file(GLOB_RECURSE files RELATIVE ${FOLDER} ${FOLDER}/*.html ${FOLDER}/*.css ${FOLDER}/*.js ${FOLDER}/*.svg)
list(SORT files)
set(arrays "")
set(table "")
set(number 0)
set(names "")
foreach(file ${files})
  get_filename_component(name ${file} NAME)
  list(FIND names ${name} same)
  if(NOT same EQUAL -1)
    message(FATAL_ERROR "two files of the page have the name ${name}")
  endif()
  list(APPEND names ${name})
  file(READ ${FOLDER}/${file} hex HEX)
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${hex}")
  get_filename_component(extension ${file} LAST_EXT)
  if(extension STREQUAL ".svg")
    set(type "image/svg+xml")
  elseif(extension STREQUAL ".js")
    set(type "text/javascript")
  else()
    string(SUBSTRING ${extension} 1 -1 type)
    set(type "text/${type}")
  endif()
  string(APPEND arrays "constexpr char kFile${number}[] = {${bytes}'\\0'};\n")
  string(APPEND table "    {\"${name}\", \"${type}\", {kFile${number}, sizeof kFile${number} - 1}},\n")
  math(EXPR number "${number} + 1")
endforeach()
file(WRITE ${OUT} "#include \"master/display/page_files.h\"\n\nnamespace quarry {\nnamespace {\n\n${arrays}
constexpr PageFile kFiles[] = {\n${table}};\n\n}  // namespace\n
const PageFile* FindPageFile(std::string_view name) {
  for (const PageFile& file : kFiles)
    if (file.name == name) return &file;
  return nullptr;
}

}  // namespace quarry\n")

#include "preprocess/preprocess_options.h"

#include <unistd.h>

#include <filesystem>

namespace quarry {
namespace {

/// The path of a program in this program's folder; empty: it is not there.
std::string ProgramBeside(const char* name) {
  std::error_code error;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", error).replace_filename(name);
  return error || ::access(program.c_str(), X_OK) != 0 ? "" : program.string();
}

}  // namespace

Placement PlacementOf(const PreprocessOptions& options, const std::string& model) {
  const auto found = options.placements.find(model);
  return found == options.placements.end() ? Placement{} : found->second;
}

ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix) {
  const std::string program = ProgramBeside("quarry-import-assimp");
  if (program.empty()) return {};
  return {program, prefix, options.memory};
}

ImageDecoding ImageDecodingOf(const PreprocessOptions& options) {
  return {ProgramBeside("quarry-import-image"), options.memory};
}

std::string SpillFolder(const PreprocessOptions& options) {
  if (!options.tmp_folder.empty()) return options.tmp_folder;
  const auto parent = std::filesystem::path(options.output).parent_path();
  return parent.empty() ? "." : parent.string();
}

}  // namespace quarry

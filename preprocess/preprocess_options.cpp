#include "preprocess/preprocess_options.h"

#include <filesystem>

#include "common/program/installed_program.h"

namespace quarry {
Placement PlacementOf(const PreprocessOptions& options, const std::string& model) {
  const auto found = options.placements.find(model);
  return found == options.placements.end() ? Placement{} : found->second;
}

ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix) {
  const std::string program = FindProgram("quarry-import-assimp");
  if (program.empty()) return {};
  return {program, prefix, options.memory};
}

ImageDecoding ImageDecodingOf(const PreprocessOptions& options) {
  return {FindProgram("quarry-import-image"), options.memory};
}

std::string SpillFolder(const PreprocessOptions& options) {
  if (!options.tmp_folder.empty()) return options.tmp_folder;
  const auto parent = std::filesystem::path(options.output).parent_path();
  return parent.empty() ? "." : parent.string();
}

}  // namespace quarry

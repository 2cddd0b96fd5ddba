#include "preprocess/preprocess_options.h"

#include <filesystem>

#include "common/program/installed_program.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {

Placement PlacementOf(const PreprocessOptions& options, const std::string& model) {
  const auto found = options.placements.find(model);
  return found == options.placements.end() ? Placement{} : found->second;
}

std::string UnpackedPath(const std::string& model) {
  const std::filesystem::path path(model);
  for (const char* const packed : {".gz", ".zst"})
    if (EqualsIgnoringCase(path.extension().string(), packed))
      return (path.parent_path() / path.stem()).string();
  return model;
}

std::vector<std::string> ModelNamesOf(const PreprocessOptions& options) {
  std::vector<std::string> names;
  for (const std::string& model : options.models)
    if (model != "-") names.push_back(std::filesystem::path(UnpackedPath(model)).filename().string());
  return names;
}

ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix) {
  const std::string program = FindProgram("quarry-import-assimp");
  if (program.empty()) return {};
  return {program, prefix, options.memory};
}

GltfDecoding GltfDecodingOf(const PreprocessOptions& options, const std::string& folder) {
  return {FindProgram("quarry-import-draco"), folder, options.memory};
}

CadReading CadReadingOf(const PreprocessOptions& options, const std::string& folder) {
  return {FindProgram("quarry-import-cad"), folder, options.memory, options.linear_deflection,
          options.angular_deflection};
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

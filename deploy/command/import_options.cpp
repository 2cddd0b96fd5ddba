#include "deploy/command/import_options.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>

namespace quarry {
namespace {

struct Option {
  const char* flag;
  std::string ImportArguments::*value;
  const char* help;
};
constexpr Option kOptions[] = {
    {"--memory", &ImportArguments::memory, "Limit of the preprocessor's memory (default: 1G)"},
    {"--crease", &ImportArguments::crease,
     "Largest angle in degrees at which triangles without normals are smoothed; 0: facets"},
    {"--deflection", &ImportArguments::deflection,
     "For STEP and IGES: LINEAR[,ANGLE], largest distance of triangles from surfaces, and largest angle "
     "between neighbours in degrees"},
    {"--scale", &ImportArguments::scale, "Factor on all coordinates"},
    {"--voxel-size", &ImportArguments::voxel_size, "Largest size of a decoded voxel's hot part"},
    {"--tmp", &ImportArguments::tmp, "Folder for the preprocessor's spill files"},
    {"--unpack-limit", &ImportArguments::unpack_limit, "Largest unpacked size of a packed model"}};
constexpr const char* kGroup = "For a model that is preprocessed first";

}  // namespace

void AddImportOptions(CLI::App& command, ImportArguments& a) {
  for (const Option& option : kOptions)
    command.add_option(option.flag, a.*option.value, option.help)->group(kGroup);
  command.add_flag("--no-textures", a.no_textures, "Leave out the images that materials name")->group(kGroup);
}

std::vector<std::string> Flags(const ImportArguments& a) {
  std::vector<std::string> flags;
  for (const Option& option : kOptions)
    if (!(a.*option.value).empty()) flags.insert(flags.end(), {option.flag, a.*option.value});
  if (a.no_textures) flags.emplace_back("--no-textures");
  return flags;
}

Status RefuseImportOptions(const ImportArguments& a, const std::string& why) {
  const auto flags = Flags(a);
  if (flags.empty()) return {};
  return BadUsage(
      fmt::format("{} is for models that are preprocessed, and {}; leave it out", flags.front(), why));
}

}  // namespace quarry

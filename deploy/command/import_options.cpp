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
    {"--memory", &ImportArguments::memory, "Of a model: ceiling on the preprocessor's memory (default: 1G)"},
    {"--crease", &ImportArguments::crease,
     "Of a model: most degrees between triangles without normals that meet smoothly; 0: facets"},
    {"--deflection", &ImportArguments::deflection,
     "Of a STEP or IGES model: LINEAR[,ANGLE], most distance of triangles from surfaces, and degrees between "
     "neighbours"},
    {"--scale", &ImportArguments::scale, "Of a model: factor on all coordinates"},
    {"--voxel-size", &ImportArguments::voxel_size, "Of a model: most bytes of a decoded voxel's hot part"},
    {"--tmp", &ImportArguments::tmp, "Of a model: folder for the preprocessor's spill files"},
    {"--unpack-limit", &ImportArguments::unpack_limit, "Of a packed model: most bytes that it unpacks to"}};

}  // namespace

void AddImportOptions(CLI::App& command, ImportArguments& a) {
  for (const Option& option : kOptions) command.add_option(option.flag, a.*option.value, option.help);
  command.add_flag("--no-textures", a.no_textures, "Of a model: leave out the images that materials name");
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

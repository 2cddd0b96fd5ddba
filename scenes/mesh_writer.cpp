#include "scenes/mesh_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "scenes/obj_writer.h"
#include "scenes/ply_writer.h"

namespace quarry::scenes {

Result<std::unique_ptr<MeshWriter>> OpenMeshWriter(const std::string& path,
                                                   const std::vector<Material>& materials, bool colors) {
  std::string extension = std::filesystem::path(path).extension();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return std::tolower(c); });
  if (extension == ".ply") return OpenPlyWriter(path, materials, colors);
  if (extension == ".obj") return OpenObjWriter(path, materials, colors);
  return BadUsage(fmt::format("{}: the name must end in .ply or .obj, which chooses the format.", path));
}

std::string WithExtension(const std::string& path, const std::string& extension) {
  return std::filesystem::path(path).replace_extension(extension);
}

}  // namespace quarry::scenes

#include "preprocess/import/ply/ply_textures.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include "preprocess/import/files/find_file.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/import/texture_image.h"

namespace quarry {

namespace fs = std::filesystem;

Result<std::vector<uint32_t>> AddPlyTextures(const PlyHeader& header, const std::string& path,
                                             ModelSink& sink) {
  std::vector<uint32_t> materials;
  if (!sink.takes_textures()) return materials;
  for (const std::string& name : header.texture_files) {
    Material material;
    material.name = name;
    material.diffuse = material.base_color = glm::vec3(1);
    const fs::path file = FindFile(path, name);
    if (file.empty()) {
      sink.Warn(fmt::format("{}: the image {} (TextureFile) is not there; its faces do without it", path,
                            Quoted(name)));
    } else {
      if (LeavesFolder(path, file))
        sink.Warn(fmt::format("{}: names the file {}, outside the model's folder; it is read anyway", path,
                              file.string()));
      TextureImage image;
      image.file = file.string();
      image.name = name;
      image.model = path;
      TextureBinding binding;
      binding.transform = {1, 0, 0, 0, -1, 1};  // v runs up
      QUARRY_ASSIGN(binding.texture, sink.AddTexture(std::move(image)));
      material.textures.push_back(binding);
    }
    materials.push_back(sink.AddMaterial(material));
  }
  return materials;
}

}  // namespace quarry

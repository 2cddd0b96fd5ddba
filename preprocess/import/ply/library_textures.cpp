#include "preprocess/import/ply/library_textures.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <utility>

#include "preprocess/import/files/find_file.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/import/texture_image.h"
#include "preprocess/import/warn_once.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// Whether a file is NAME.image-... beside NAME.materials.json.
bool IsOfLibrary(const std::string& file, std::string_view library) {
  constexpr std::string_view kEnd = ".materials.json";
  if (!library.ends_with(kEnd)) return false;
  library.remove_suffix(kEnd.size());
  const std::string prefix = std::string(library) + ".image-";
  return file.starts_with(prefix) && file.find('/', prefix.size()) == std::string::npos;
}

}  // namespace

Status AddLibraryTextures(const std::vector<MaterialLibrary::Image>& images, const std::string& library,
                          const std::string& model, ModelSink& sink, Material& material) {
  if (!sink.takes_textures()) return {};
  bool warned = false;  // of texture coordinates
  for (const MaterialLibrary::Image& from : images) {
    const std::string& name = from.name.empty() ? from.file : from.name;
    if (from.coordinates != 0) {
      if (!std::exchange(warned, true))
        sink.Warn(
            fmt::format("{}: the material {} uses more than one set of texture coordinates, and a triangle "
                        "carries only one; textures of the others are left out",
                        model, Quoted(material.name)));
      continue;
    }
    const bool own = IsOfLibrary(from.file, library);
    const fs::path file = own ? fs::path(from.file) : FindFile(model, from.file);
    if (file.empty()) {
      sink.Warn(
          fmt::format("{}: the image {} is not there; the material does without it", model, Quoted(name)));
      continue;
    }
    if (!own && LeavesFolder(model, file))
      sink.Warn(fmt::format("{}: names the file {}, outside the model's folder; it is read anyway", model,
                            file.string()));
    TextureImage image;
    image.file = file.string();
    image.name = name;
    image.model = model;
    const TextureUse use = from.binding.use;
    image.color = use == TextureUse::kDiffuse || use == TextureUse::kSpecular || use == TextureUse::kEmission;
    image.pick = use == TextureUse::kOpacity ? TexturePick::kScalar : TexturePick::kColor;
    TextureBinding binding = Bounded(from.binding);
    QUARRY_ASSIGN(binding.texture, sink.AddTexture(std::move(image)));
    material.textures.push_back(binding);
  }
  return {};
}

}  // namespace quarry

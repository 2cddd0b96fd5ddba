#include "preprocess/import/gltf/gltf_textures.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "preprocess/import/files/find_file.h"
#include "preprocess/import/gltf/gltf_material.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

Result<TextureWrap> WrapOf(const GltfDocument& document, const Json& sampler, const char* key) {
  QUARRY_ASSIGN(const uint64_t wrap, document.Unsigned(sampler, "a sampler", key, 10497));
  switch (wrap) {
    case 10497:
      return TextureWrap::kRepeat;
    case 33071:
      return TextureWrap::kClamp;
    case 33648:
      return TextureWrap::kMirror;
    default:
      return document.FailAt(fmt::format("a sampler's {} of {} is unknown", key, wrap));
  }
}

/// KHR_texture_transform: scales, rotates counter-clockwise as seen in the image, then translates. The
/// specification's text, its test model and renderers agree on the direction; its GLSL rotates the other way.
bool ReadTextureTransform(const Json& transform, std::array<float, 6>& out) {
  glm::dvec2 offset(0), scale(1);
  ReadNumbers(transform, "offset", 2, offset);
  ReadNumbers(transform, "scale", 2, scale);
  const double turn = transform.value("rotation", 0.0);
  const double c = std::cos(turn), s = std::sin(turn);
  const double rows[6] = {c * scale.x, s * scale.y, offset.x, -s * scale.x, c * scale.y, offset.y};
  for (size_t i = 0; i < 6; ++i) {
    if (!(std::fabs(rows[i]) <= 1e30)) return false;
    out[i] = static_cast<float>(rows[i]);
  }
  return true;
}

}  // namespace

Result<GltfTextures::Sampled> GltfTextures::Find(uint64_t index) const {
  QUARRY_ASSIGN(const Json* texture, document_.Find("textures", index));
  const std::string where = fmt::format("textures[{}]", index);
  Sampled sampled{0, TextureWrap::kRepeat, TextureWrap::kRepeat};
  const Json& webp = Member(Member(*texture, "extensions"), "EXT_texture_webp");
  if (!texture->contains("source") && !webp.contains("source"))
    return document_.FailAt(where + " has no image of a format that is read");
  QUARRY_ASSIGN(sampled.image,
                document_.Unsigned(texture->contains("source") ? *texture : webp, where, "source"));
  if (texture->contains("sampler")) {
    QUARRY_ASSIGN(const uint64_t sampler_index, document_.Unsigned(*texture, where, "sampler"));
    QUARRY_ASSIGN(const Json* sampler, document_.Find("samplers", sampler_index));
    QUARRY_ASSIGN(sampled.wrap_s, WrapOf(document_, *sampler, "wrapS"));
    QUARRY_ASSIGN(sampled.wrap_t, WrapOf(document_, *sampler, "wrapT"));
  }
  return sampled;
}

/// The place of an image's bytes.
Result<TextureImage> GltfTextures::Locate(uint64_t index) {
  QUARRY_ASSIGN(const Json* json, document_.Find("images", index));
  TextureImage image;
  image.model = document_.path();
  image.name = json->value("name", "");
  if (json->contains("uri")) {
    const auto uri = json->at("uri").get<std::string>();
    if (uri.starts_with("data:")) {
      if (image.name.empty()) image.name = fmt::format("images[{}]", index);
      QUARRY_ASSIGN(image.content, document_.ReadDataUri(uri, fmt::format("images[{}]", index)));
      if (image.content.empty()) return document_.FailAt(fmt::format("images[{}] is empty", index));
      return image;
    }
    const std::string name = document_.FileNameOf(uri);
    image.name = name;
    if (std::filesystem::path(name).is_absolute())
      return document_.FailAt(fmt::format(
          "the image {} is named by an absolute path; the material does without it", Quoted(name)));
    if (LeavesFolder(document_.path(), document_.PathOf(name)))
      return document_.FailAt(fmt::format(
          "the image {} lies outside the model's folder; the material does without it", Quoted(name)));
    const auto file = FindFile(document_.path(), name);
    if (file.empty())
      return document_.FailAt(
          fmt::format("the image {} is not there; the material does without it", Quoted(name)));
    image.file = file.string();
    return image;
  }
  if (image.name.empty()) image.name = fmt::format("images[{}]", index);
  const std::string where = fmt::format("images[{}]", index);
  QUARRY_ASSIGN(const uint64_t view_index, document_.Unsigned(*json, where, "bufferView"));
  QUARRY_ASSIGN(const Json* view, document_.Find("bufferViews", view_index));
  const std::string view_name = fmt::format("bufferViews[{}]", view_index);
  QUARRY_ASSIGN(const uint64_t buffer, document_.Unsigned(*view, view_name, "buffer"));
  QUARRY_ASSIGN(const uint64_t begin, document_.Unsigned(*view, view_name, "byteOffset", 0));
  QUARRY_ASSIGN(image.size, document_.Unsigned(*view, view_name, "byteLength"));
  if (image.size == 0) return document_.FailAt(where + " is empty");
  QUARRY_ASSIGN(GltfDocument::Range range, document_.RangeOf(buffer, begin, image.size));
  image.file = std::move(range.file);
  image.offset = range.offset;
  image.content.assign(range.content.begin(), range.content.end());
  return image;
}

uint32_t GltfTextures::UvSetOf(const Json& info) {
  const Json& transform = Member(Member(info, "extensions"), "KHR_texture_transform");
  const Json& by = transform.contains("texCoord") ? transform : info;
  const auto found = by.find("texCoord");
  if (found == by.end()) return 0;
  const bool is_number = found->is_number_unsigned() && found->get<uint64_t>() < kNoIndex;
  return is_number ? found->get<uint32_t>() : kNoIndex;
}

Result<uint64_t> GltfTextures::Complete(const Json& info, const std::string& material,
                                        TextureBinding& binding) const {
  const std::string where = "a material's texture";
  QUARRY_ASSIGN(const uint64_t texture, document_.Unsigned(info, where, "index"));
  const Json& transform = Member(Member(info, "extensions"), "KHR_texture_transform");
  if (UvSetOf(info) != uv_set_)
    return document_.FailAt(
        fmt::format("the material {} uses more than one set of texture coordinates, and a triangle carries "
                    "only TEXCOORD_{}; textures of the others are left out",
                    Quoted(material), uv_set_));
  QUARRY_ASSIGN(const Sampled sampled, Find(texture));
  binding.wrap_s = sampled.wrap_s;
  binding.wrap_t = sampled.wrap_t;
  if (!ReadTextureTransform(transform, binding.transform))
    return document_.FailAt(
        "a KHR_texture_transform holds invalid numbers; the material does without its texture");
  return sampled.image;
}

/// A value of the wrong type costs the texture alone, not the model.
template <class Read>
std::invoke_result_t<Read> GltfTextures::Guarded(Read&& read) const {
  try {
    return read();
  } catch (const Json::exception& e) {
    return document_.FailAt(
        fmt::format("a texture or its image cannot be read ({}); the material does without it", e.what()));
  }
}

Status GltfTextures::Add(const Json& info, TextureBinding binding, bool color, TexturePick pick,
                         Material& material) {
  if (!info.contains("index") || !sink_.takes_textures()) return {};
  const Result<uint64_t> image_index = Guarded([&] { return Complete(info, material.name, binding); });
  if (!image_index) {
    Warn(image_index.error().message);
    return {};
  }
  const auto key = std::tuple(*image_index, color, pick);
  auto given = given_.find(key);
  if (given == given_.end()) {
    Result<TextureImage> image = Guarded([&] { return Locate(*image_index); });
    if (!image) {
      Warn(image.error().message);
      return {};
    }
    image->color = color;
    image->pick = pick;
    QUARRY_ASSIGN(const uint32_t texture, sink_.AddTexture(std::move(*image)));
    given = given_.emplace(key, texture).first;
  }
  binding.texture = given->second;
  material.textures.push_back(Bounded(binding));
  return {};
}

}  // namespace quarry

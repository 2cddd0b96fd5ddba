#include "preprocess/import/gltf_material.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

namespace quarry {
namespace {

using Json = nlohmann::json;

glm::vec3 Clamped(const glm::vec3& v) {
  glm::vec3 out;
  for (int a = 0; a < 3; ++a) out[a] = v[a] > 0 ? std::min(v[a], 1.0f) : 0.0f;
  return out;
}

TextureBinding Use(TextureUse use, const glm::vec4& factor) {
  TextureBinding binding;
  binding.use = use;
  binding.factor = factor;
  return binding;
}

}  // namespace

const Json& Member(const Json& object, const char* key) {
  static const Json kEmpty = Json::object();
  const auto it = object.find(key);
  return it != object.end() && it->is_object() ? *it : kEmpty;
}

Result<Material> ToMaterial(const Json& json, size_t index, GltfTextures& textures) {
  Material m;
  m.name = json.value("name", "");
  if (m.name.empty()) m.name = fmt::format("material {}", index);
  const Json& pbr = Member(json, "pbrMetallicRoughness");
  glm::vec4 base(1);
  ReadNumbers(pbr, "baseColorFactor", 4, base);
  const auto factor = [](const Json& object, const char* key, float fallback) {
    const auto value = object.value(key, fallback);
    return value >= 0 ? std::min(value, 1.0f) : 0.0f;
  };
  const float metallic = factor(pbr, "metallicFactor", 1), roughness = factor(pbr, "roughnessFactor", 1);
  const Json& extensions = Member(json, "extensions");
  const float transmission =
      factor(Member(extensions, "KHR_materials_transmission"), "transmissionFactor", 0);
  const bool blend = json.value("alphaMode", "OPAQUE") == "BLEND";
  const float alpha = blend ? std::clamp(base.a, 0.0f, 1.0f) : 1;
  const glm::vec3 color = Clamped(glm::vec3(base));
  m.diffuse = color * ((1 - metallic) * alpha * (1 - transmission));
  m.transmittance = glm::vec3(1 - alpha) + color * (alpha * (1 - metallic) * transmission);
  const float smooth = (1 - roughness) * (1 - roughness);
  m.reflectance = color * (metallic * smooth);
  m.specular = color * (metallic * (1 - smooth)) + glm::vec3(0.04f * (1 - metallic));
  const float width = std::max(roughness * roughness, 0.02f);
  m.shininess = std::clamp(2 / (width * width) - 2, 0.0f, 10000.0f);
  m.ior = transmission > 0
              ? std::clamp(Member(extensions, "KHR_materials_ior").value("ior", 1.5f), 1.0f, 10.0f)
              : 1;
  m.fresnel = transmission > 0;
  if (m.fresnel) m.reflectance = Clamped(m.reflectance + glm::vec3(1 - metallic) * smooth);
  glm::vec3 emission(0);
  ReadNumbers(json, "emissiveFactor", 3, emission);
  const float strength =
      Bounded(Member(extensions, "KHR_materials_emissive_strength").value("emissiveStrength", 1.0f));
  for (int a = 0; a < 3; ++a) m.emission[a] = std::max(Clamped(emission)[a] * std::max(strength, 0.0f), 0.0f);

  const std::string alpha_mode = json.value("alphaMode", "OPAQUE");
  const bool opaque = alpha_mode != "BLEND" && alpha_mode != "MASK";
  const auto pick = opaque ? TexturePick::kColor : TexturePick::kColorAndAlpha;
  const Json& base_texture = Member(pbr, "baseColorTexture");
  const glm::vec4 base_factor(color, std::clamp(base.a, 0.0f, 1.0f));
  QUARRY_TRY(textures.Add(base_texture, Use(TextureUse::kDiffuse, base_factor), true, pick, m));
  QUARRY_TRY(textures.Add(Member(json, "emissiveTexture"),
                          Use(TextureUse::kEmission, glm::vec4(m.emission, 1)), true, TexturePick::kColor,
                          m));
  if (!opaque) {
    TextureBinding opacity = Use(TextureUse::kOpacity, base_factor);
    if (alpha_mode == "MASK") opacity.cutoff = factor(json, "alphaCutoff", 0.5f);
    QUARRY_TRY(textures.Add(base_texture, opacity, true, pick, m));
  }
  const Json& normal = Member(json, "normalTexture");
  const auto strength_of_normals = normal.value("scale", 1.0f);
  QUARRY_TRY(textures.Add(normal, Use(TextureUse::kNormal, glm::vec4(strength_of_normals)), false,
                          TexturePick::kColor, m));
  QUARRY_TRY(textures.Add(Member(pbr, "metallicRoughnessTexture"),
                          Use(TextureUse::kMetalRoughness, {1, roughness, metallic, 1}), false,
                          TexturePick::kColor, m));
  return m;
}

}  // namespace quarry

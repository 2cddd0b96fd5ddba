#include "preprocess/import/gltf/gltf_material.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <nlohmann/json.hpp>

#include "common/scene/open_pbr.h"

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

float Factor(const Json& object, const char* key, float fallback) {
  const auto value = object.value(key, fallback);
  return value >= 0 ? std::min(value, 1.0f) : 0.0f;
}

/// Converts KHR_materials_pbrSpecularGlossiness to metalness and roughness: reflection beyond the 0.04 of
/// dielectrics makes a metal. Source: the conversion in the extension's specification.
void ReadSpecularGlossiness(const Json& json, Material& m) {
  glm::vec4 diffuse(1);
  glm::vec3 specular(1);
  ReadNumbers(json, "diffuseFactor", 4, diffuse);
  ReadNumbers(json, "specularFactor", 3, specular);
  const glm::vec3 matte = Clamped(glm::vec3(diffuse)), mirror = Clamped(specular);
  const auto brightness = [](const glm::vec3& c) {
    return std::sqrt(0.299f * c.x * c.x + 0.587f * c.y * c.y + 0.114f * c.z * c.z);
  };
  constexpr float kDielectric = 0.04f;
  const float strongest = std::max({mirror.x, mirror.y, mirror.z});
  float metal = 0;
  if (const float s = brightness(mirror); s > kDielectric) {
    const float b = brightness(matte) * (1 - strongest) / (1 - kDielectric) + s - 2 * kDielectric;
    metal = std::clamp(
        (std::sqrt(std::max(b * b - 4 * kDielectric * (kDielectric - s), 0.0f)) - b) / (2 * kDielectric),
        0.0f, 1.0f);
  }
  const glm::vec3 of_matte = matte * ((1 - strongest) / ((1 - kDielectric) * std::max(1 - metal, 1e-6f)));
  const glm::vec3 of_mirror = (mirror - glm::vec3(kDielectric * (1 - metal))) / std::max(metal, 1e-6f);
  m.base_color = Clamped(glm::mix(of_matte, of_mirror, metal * metal));
  m.base_metalness = metal;
  m.specular_roughness = 1 - Factor(json, "glossinessFactor", 1);
}

/// Reads the extensions of the metallic-roughness model.
void ReadExtensions(const Json& extensions, Material& m) {
  const Json& ior = Member(extensions, "KHR_materials_ior");
  // 0 stands for full reflection in the specification.
  const auto index = ior.value("ior", 1.5f);
  m.specular_ior = index == 0 ? 10.0f : std::clamp(Bounded(index), 1.0f, 10.0f);
  const Json& specular = Member(extensions, "KHR_materials_specular");
  m.specular_weight = Factor(specular, "specularFactor", 1);
  ReadNumbers(specular, "specularColorFactor", 3, m.specular_color);
  m.specular_color = Clamped(m.specular_color);
  m.transmission_weight = Factor(Member(extensions, "KHR_materials_transmission"), "transmissionFactor", 0);
  const Json& volume = Member(extensions, "KHR_materials_volume");
  ReadNumbers(volume, "attenuationColor", 3, m.transmission_color);
  m.transmission_color = Clamped(m.transmission_color);
  m.transmission_depth = std::max(Bounded(volume.value("attenuationDistance", 0.0f)), 0.0f);
  m.unlit = extensions.contains("KHR_materials_unlit");
}

const Json& BaseTexture(const Json& pbr) {
  return Member(pbr, pbr.contains("diffuseTexture") ? "diffuseTexture" : "baseColorTexture");
}

/// The set of texture coordinates of the base colour, else of the first texture of a material.
uint32_t UvSetOf(const Json& json, const Json& pbr) {
  for (const Json* info : {&BaseTexture(pbr), &Member(json, "emissiveTexture"),
                           &Member(json, "normalTexture"), &Member(pbr, "metallicRoughnessTexture")})
    if (info->contains("index")) return GltfTextures::UvSetOf(*info);
  return 0;
}

/// Adds base colour or diffuse (`color` is its factor), emission, opacity, normals, metalness and roughness.
Status AddTextures(const Json& json, const Json& pbr, const glm::vec4& color, const std::string& alpha_mode,
                   GltfTextures& textures, Material& m) {
  const bool opaque = alpha_mode != "BLEND" && alpha_mode != "MASK";
  const auto pick = opaque ? TexturePick::kColor : TexturePick::kColorAndAlpha;
  const Json& base = BaseTexture(pbr);
  QUARRY_TRY(textures.Add(base, Use(TextureUse::kDiffuse, color), true, pick, m));
  QUARRY_TRY(textures.Add(Member(json, "emissiveTexture"),
                          Use(TextureUse::kEmission, glm::vec4(m.emission, 1)), true, TexturePick::kColor,
                          m));
  const float cutoff = Factor(json, "alphaCutoff", 0.5f);
  if (!opaque && (alpha_mode == "BLEND" || cutoff > 0)) {  // at a cut-off of 0 all is opaque
    TextureBinding opacity = Use(TextureUse::kOpacity, color);
    if (alpha_mode == "MASK") opacity.cutoff = cutoff;
    QUARRY_TRY(textures.Add(base, opacity, true, pick, m));
  }
  const Json& normal = Member(json, "normalTexture");
  const auto strength_of_normals = normal.value("scale", 1.0f);
  QUARRY_TRY(textures.Add(normal, Use(TextureUse::kNormal, glm::vec4(strength_of_normals)), false,
                          TexturePick::kColor, m));
  return textures.Add(Member(pbr, "metallicRoughnessTexture"),
                      Use(TextureUse::kMetalRoughness, {1, m.specular_roughness, m.base_metalness, 1}), false,
                      TexturePick::kColor, m);
}

}  // namespace

const Json& Member(const Json& object, const char* key) {
  static const Json kEmpty = Json::object();
  const auto it = object.find(key);
  return it != object.end() && it->is_object() ? *it : kEmpty;
}

Result<Material> ToMaterial(const Json& json, size_t index, GltfTextures& textures, uint32_t& uv_set,
                            float vertex_alpha) {
  Material m;
  m.name = json.value("name", "");
  if (m.name.empty()) m.name = fmt::format("material {}", index);
  const Json& extensions = Member(json, "extensions");
  const Json& glossy = Member(extensions, "KHR_materials_pbrSpecularGlossiness");
  const bool is_glossy = extensions.contains("KHR_materials_pbrSpecularGlossiness");
  const Json& pbr = Member(json, "pbrMetallicRoughness");
  glm::vec4 base(1);
  ReadNumbers(is_glossy ? glossy : pbr, is_glossy ? "diffuseFactor" : "baseColorFactor", 4, base);
  const float alpha = std::clamp(base.a, 0.0f, 1.0f) * vertex_alpha;
  ReadExtensions(extensions, m);
  if (is_glossy) {
    ReadSpecularGlossiness(glossy, m);
  } else {
    m.base_color = Clamped(glm::vec3(base));
    m.base_metalness = Factor(pbr, "metallicFactor", 1);
    m.specular_roughness = Factor(pbr, "roughnessFactor", 1);
  }
  const std::string alpha_mode = json.value("alphaMode", "OPAQUE");
  if (alpha_mode == "BLEND") m.geometry_opacity = alpha;
  // A texel multiplies the factor; without a texture the factor alone decides the cut-out.
  const float cutoff = Factor(json, "alphaCutoff", 0.5f);
  if (alpha_mode == "MASK" && alpha < cutoff) m.geometry_opacity = 0;
  glm::vec3 emission(0);
  ReadNumbers(json, "emissiveFactor", 3, emission);
  const float strength =
      Bounded(Member(extensions, "KHR_materials_emissive_strength").value("emissiveStrength", 1.0f));
  m.emission = Clamped(emission) * std::max(strength, 0.0f);
  const float thickness = Member(extensions, "KHR_materials_volume").value("thicknessFactor", 0.0f);
  if (m.transmission_depth <= 0) m.transmission_color = m.base_color;
  DeriveWhitted(m, thickness > 0);
  const Json& surface = is_glossy ? glossy : pbr;
  uv_set = UvSetOf(json, surface);
  textures.UseSet(uv_set);
  QUARRY_TRY(AddTextures(json, surface, {m.base_color, alpha}, alpha_mode, textures, m));
  return m;
}

}  // namespace quarry

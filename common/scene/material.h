#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <vector>

namespace quarry {

/// No index: a corner without a normal, a face without a part.
inline constexpr uint32_t kNoIndex = 0xFFFFFFFFu;

/// What a texture says of a surface; the material's own value stands where there is none.
enum class TextureUse : uint32_t {
  kDiffuse,         ///< colour, linear once decoded
  kSpecular,        ///< colour
  kEmission,        ///< colour
  kOpacity,         ///< the texture's last channel: 1 is opaque
  kNormal,          ///< a direction in tangent space: 2 rgb - 1
  kBump,            ///< heights; some files name normal maps so, which are blue on the average
  kMetalRoughness,  ///< green: roughness, blue: metalness, as in glTF
};
inline constexpr uint32_t kTextureUses = 7;

/// What a texture shows beyond its borders.
enum class TextureWrap : uint32_t { kRepeat, kClamp, kMirror };
inline constexpr uint32_t kTextureWraps = 3;

/// One texture as one material uses it. (s, t) = transform * (u, v, 1); (0, 0) is the corner of the image's
/// first texel, t runs down its rows. The value is `factor` times the texel (alpha its last channel):
/// `factor` stands in the place of the material's own value, and holds what that has been mixed from.
struct TextureBinding {
  TextureUse use = TextureUse::kDiffuse;
  uint32_t texture = kNoIndex;
  TextureWrap wrap_s = TextureWrap::kRepeat, wrap_t = TextureWrap::kRepeat;
  std::array<float, 6> transform{1, 0, 0, 0, 1, 0};  ///< two rows of three
  glm::vec4 factor{1};  ///< kNormal, kBump: the first is their strength; kMetalRoughness: green and blue
  float cutoff = 0;     ///< kOpacity: less is not there at all, all else opaque; 0: as it says

  bool operator==(const TextureBinding&) const = default;
};

/// How a surface scatters light, said twice: by the weights of Whitted's rays, which the modes of today go
/// by, and by the parameters of OpenPBR under its names, of which the modes whose rays end at the first
/// surface take the base colour. Importers that know one form derive the other (open_pbr.h). Colours are
/// linear RGB; each component lies in [0,1] (importers clamp), of emission in [0,inf).
struct Material {
  std::string name;
  glm::vec3 diffuse{0.8f};        ///< Lambertian albedo; vertex colours multiply it.
  glm::vec3 specular{0.0f};       ///< Weight of the Blinn-Phong highlight of lights.
  glm::vec3 emission{0.0f};       ///< Radiance given off.
  glm::vec3 reflectance{0.0f};    ///< Weight of the mirror ray (whitted).
  glm::vec3 transmittance{0.0f};  ///< Weight of the transmitted ray (whitted).
  float shininess = 0.0f;         ///< Blinn-Phong exponent, [0, 10000].
  float ior = 1.0f;               ///< Index of refraction, [1, 10]; 1 passes straight through.
  bool fresnel = false;           ///< Schlick's weights shift reflectance and transmittance with the angle.
  bool unlit = false;             ///< No light matters; vertex colours multiply the emission instead.

  glm::vec3 base_color{0.8f};          ///< Of the diffuse part, or of the metal.
  float base_metalness = 0.0f;         ///< [0, 1]
  float specular_roughness = 1.0f;     ///< [0, 1]; 0 is a mirror.
  float specular_weight = 0.0f;        ///< [0, 1]; 0: no highlight on what is no metal.
  glm::vec3 specular_color{1.0f};      ///< Tint of the highlight on what is no metal.
  float specular_ior = 1.5f;           ///< [1, 10]; decides how much is reflected.
  float transmission_weight = 0.0f;    ///< [0, 1]: what passes of the part that is no metal.
  glm::vec3 transmission_color{1.0f};  ///< What is left of light after transmission_depth.
  float transmission_depth = 0.0f;     ///< Scene units, [0, inf); 0: the surface alone is tinted.
  float geometry_opacity = 1.0f;       ///< [0, 1]: how much of the surface is there at all.

  std::vector<TextureBinding> textures;  ///< at most one a use, by rising use

  bool operator==(const Material&) const = default;
};

}  // namespace quarry

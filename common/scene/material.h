#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>
#include <string>
#include <vector>

namespace quarry {

/// The index of nothing: of a corner without a normal, of a face without a part.
inline constexpr uint32_t kNoIndex = 0xFFFFFFFFu;

/// The property of a surface that a texture gives. Without a texture the material's own value counts.
enum class TextureUse : uint32_t {
  kDiffuse,         ///< colour, linear once decoded
  kSpecular,        ///< colour
  kEmission,        ///< colour
  kOpacity,         ///< the texture's last channel: 1 is opaque
  kNormal,          ///< a direction in tangent space: 2 rgb - 1
  kBump,            ///< heights; in some files a normal map, whose mean colour is blue
  kMetalRoughness,  ///< green: roughness, blue: metalness, as in glTF
};
inline constexpr uint32_t kTextureUses = 7;

/// The content of a texture beyond its borders.
enum class TextureWrap : uint32_t { kRepeat, kClamp, kMirror };
inline constexpr uint32_t kTextureWraps = 3;

/// The use of a texture by a material. The position is (s, t) = transform * (u, v, 1); (0, 0) is the corner
/// of the image's first texel, and t runs down its rows. The value is `factor` times the texel, whose last
/// channel is alpha. It replaces the material's own value as it was before importers mixed it with metalness
/// and transparency.
struct TextureBinding {
  TextureUse use = TextureUse::kDiffuse;
  uint32_t texture = kNoIndex;
  TextureWrap wrap_s = TextureWrap::kRepeat, wrap_t = TextureWrap::kRepeat;
  std::array<float, 6> transform{1, 0, 0, 0, 1, 0};  ///< two rows of three numbers
  glm::vec4 factor{1};  ///< kNormal, kBump: x is the strength; kMetalRoughness: y and z
  float cutoff = 0;     ///< kOpacity: below it transparent, else opaque; 0: off

  bool operator==(const TextureBinding&) const = default;
};

/// The way a surface scatters light, in two forms: the weights of Whitted's rays, and the parameters of
/// OpenPBR under their names there. Modes whose rays end at the first surface use base_color; all else in
/// today's modes uses the weights. Importers derive the form that a file lacks (open_pbr.h).
/// Units: colours in linear RGB, components in [0, 1], of emission in [0, inf).
struct Material {
  std::string name;
  glm::vec3 diffuse{0.8f};        ///< Lambertian albedo; vertex colours multiply it
  glm::vec3 specular{0.0f};       ///< weight of the Blinn-Phong highlight
  glm::vec3 emission{0.0f};       ///< emitted radiance
  glm::vec3 reflectance{0.0f};    ///< weight of the reflected ray (whitted)
  glm::vec3 transmittance{0.0f};  ///< weight of the transmitted ray (whitted)
  float shininess = 0.0f;         ///< Blinn-Phong exponent, [0, 10000]
  float ior = 1.0f;               ///< index of refraction, [1, 10]; 1: rays go straight on
  bool fresnel = false;           ///< whether Schlick's weights apply
  bool unlit = false;             ///< no light counts; vertex colours multiply the emission
  /// The form that the file gave; the other is derived from it. Textures replace this one's values.
  bool is_open_pbr = true;

  glm::vec3 base_color{0.8f};          ///< of the diffuse part, or of the metal
  float base_metalness = 0.0f;         ///< [0, 1]
  float specular_roughness = 1.0f;     ///< [0, 1]; 0 is a mirror.
  float specular_weight = 0.0f;        ///< [0, 1]; 0: no highlight, metals excepted
  glm::vec3 specular_color{1.0f};      ///< tint of the highlight, metals excepted
  float specular_ior = 1.5f;           ///< [1, 10]; decides the reflected share
  float transmission_weight = 0.0f;    ///< [0, 1]; transmitted share of the part that is not metal
  glm::vec3 transmission_color{1.0f};  ///< share of light left after transmission_depth
  float transmission_depth = 0.0f;     ///< scene units, [0, inf); 0: only the surface tints
  float geometry_opacity = 1.0f;       ///< [0, 1]; share of the surface that exists

  std::vector<TextureBinding> textures;  ///< at most one per use, by ascending use

  bool operator==(const Material&) const = default;
};

/// Whether the surface is see-through: shadow rays pass it, and it tints their light.
inline bool LetsLightThrough(const Material& m) { return m.transmittance != glm::vec3(0); }

}  // namespace quarry

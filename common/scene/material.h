#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <string>

namespace quarry {

/// No index: a corner without a normal, a face without a part.
inline constexpr uint32_t kNoIndex = 0xFFFFFFFFu;

/// How a surface scatters light. Colours are linear RGB; each component of diffuse, specular, reflectance and
/// transmittance lies in [0,1] (importers clamp), emission in [0,inf).
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

  bool operator==(const Material&) const = default;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <vector>

#include "common/engine/integrators/path/path_bsdf.h"

namespace quarry {

/// The boundary of glass whose facets are GGX: each mirrors a share and refracts the rest. Weights are scaled
/// up for light that meets facets again, so that glass neither loses nor gains light. As with smooth glass,
/// radiance keeps its value where it changes the medium. Directions, weights and densities: as PathBsdf.
/// Immutable, so thread-safe. Source: Walter et al. 2007, sections 4 and 5; Turquin 2019 for the scale.
class RoughGlass {
 public:
  /// Whether a surface has this, and not ThroughGlass(): glass that has a thickness, is rough, and bends
  /// light. Glass with the weights of Whitted's rays is smooth: its roughness is that of its highlights.
  static bool Is(const SurfaceProperties& properties) {
    constexpr float kLeastIndex = 1.2f;  // below it GlassTable is too coarse
    const float roughness = properties.specular_roughness;
    return properties.is_open_pbr && properties.ior > 1 && properties.specular_ior >= kLeastIndex &&
           roughness * roughness >= PathBsdf::kLeastAlpha;
  }
  RoughGlass(const SurfaceProperties& properties, const Surface& surface);
  /// Light can come from both sides.
  static glm::vec3 lit_side() { return glm::vec3(0); }

  PathBsdf::Scattered Toward(const glm::vec3& light) const;
  PathBsdf::Sample SampleDirection(const glm::vec2& u, float choice) const;

 private:
  PathBsdf::Scattered Mirrored(const glm::vec3& light) const;
  PathBsdf::Scattered Refracted(const glm::vec3& light) const;

  glm::vec3 normal_, tangent_, bitangent_;
  glm::vec3 side_;  ///< the geometric normal, toward the viewer
  glm::vec3 view_;  ///< in the frame
  glm::vec3 tint_;  ///< of light that passes
  float alpha_, index_;
  float scale_;  ///< of weights
};

/// The shares of light that the facets of rough glass send on, mirrored or refracted, at once. Made once, on
/// first use, in about 0.13 s. Immutable, so thread-safe. Memory: 19 KiB.
class GlassTable {
 public:
  static const GlassTable& Get();
  /// `cosine`, `roughness`: as of AlbedoTables. `index`: of the medium behind over that of the viewer's side,
  /// in [1/10, 10].
  float SentOn(float cosine, float roughness, float index) const;

 private:
  static constexpr uint32_t kSide = 16;     ///< nodes by direction and by roughness
  static constexpr uint32_t kIndices = 19;  ///< nodes by index, evenly by the root of the mirrored share
  GlassTable();
  std::vector<float> shares_;  ///< by index, roughness and direction
};

}  // namespace quarry

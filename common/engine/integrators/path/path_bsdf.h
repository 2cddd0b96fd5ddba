#pragma once

#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/engine/integrators/path/ggx.h"
#include "common/engine/surfaces/surface.h"
#include "common/scene/surface_properties.h"

// Scattering at the vertices of paths. Thread-safe. Directions are unit vectors that leave the surface;
// weights are linear RGB; densities are by solid angle.

namespace quarry {

/// The opaque part of a surface: metal, and a matt body under a clear specular layer. The layer takes its
/// share by the directional albedo of the viewer's side, so that no light is lost or gained. The facets of
/// the layer and of metal are GGX; their lobes are scaled up for light that is reflected more than once.
/// Shading normals: light and viewer must lie on one side of the geometric normal, so that thin sheets do not
/// leak. Where light grazes the triangle more than the shading normal says, it fades out (TerminatorShare()),
/// so that no hard edge of black follows the triangles.
/// Source: the mix of metal and dielectric base of OpenPBR; Turquin 2019 for multiple scattering,
/// with the mean shares of Kulla & Conty 2017.
class PathBsdf {
 public:
  /// Below this width facets are a mirror. A judgement: the highlight is narrower than the sun.
  static constexpr float kLeastAlpha = 0.002f;

  PathBsdf(const SurfaceProperties& properties, const Surface& surface);

  /// The side from which light can come: the geometric normal, toward the viewer.
  const glm::vec3& lit_side() const { return side_; }

  struct Scattered {
    glm::vec3 weight{0};  ///< of the light from a direction: the BSDF times the cosine
    float density = 0;    ///< with which Sample() finds the direction
  };
  /// The scattering of light from a direction; without that of a mirror.
  Scattered Toward(const glm::vec3& light) const;

  struct Sample {
    glm::vec3 direction{0};
    glm::vec3 weight{0};  ///< of the radiance from there, the density is divided out; 0: the path ends
    float density = 0;    ///< 0: a mirror's direction, which no light is sampled for
    float width = 0;      ///< how far cones widen, the half angle of the lobe in radians
  };
  /// A direction for the path to go on. `u`, `choice`: in [0, 1).
  Sample SampleDirection(const glm::vec2& u, float choice) const;

 private:
  bool is_mirror() const { return alpha_ < kLeastAlpha; }
  /// The reflected share of a facet.
  glm::vec3 Reflected(float toward) const;
  glm::vec3 ToWorld(const glm::vec3& v) const { return tangent_ * v.x + bitangent_ * v.y + normal_ * v.z; }
  glm::vec3 ToLocal(const glm::vec3& v) const {
    return {glm::dot(v, tangent_), glm::dot(v, bitangent_), glm::dot(v, normal_)};
  }
  Scattered Toward(const glm::vec3& world, const glm::vec3& light) const;

  glm::vec3 normal_, tangent_, bitangent_;
  glm::vec3 side_;  ///< the geometric normal, toward the viewer
  glm::vec3 view_;  ///< in the frame
  glm::vec3 matt_;  ///< albedo of the body, less the layer's share
  glm::vec3 metal_, metal_edge_, layer_, made_up_;
  float alpha_, ior_;
  float specular_chance_;  ///< that Sample() chooses a facet
};

/// The direction of a mirrored ray: by the shading normal, and mirrored once more at the triangle's plane
/// where that would lead into the surface.
glm::vec3 MirrorDirection(const Surface& surface);

/// A ray that meets smooth glass: a boundary between media, or a pane (`ior` 1), behind which it goes
/// straight on. `choice`: in [0, 1), decides between reflection and transmission.
struct GlassRay {
  glm::vec3 direction{0}, weight{0};
  bool transmitted = false;
};
GlassRay ThroughGlass(const SurfaceProperties& properties, const Surface& surface, float choice);

/// The shares of a surface that rays pass straight on, which are no vertices.
struct Passing {
  float hole = 0;     ///< share where there is no surface
  float pane = 0;     ///< share where a thin pane lets light pass
  glm::vec3 tint{1};  ///< of the pane
  float glass = 0;    ///< share of glass that is a vertex; of a pane that rays pass, its mirror
  glm::vec3 Light() const { return glm::vec3(hole) + tint * pane; }
};
/// `cosine`: between ray and geometric normal, at least 0. `has_map`: the opacity's map has decided already.
/// `is_hidden`: the pane has textures that light rays do not look up, so that they do not pass it.
Passing PassingOf(const SurfaceProperties& properties, float cosine, bool has_map, bool is_hidden);

/// The share of light where the shading normal is brighter than the geometric normal allows, from 0 where the
/// light grazes the triangle to 1. Source: Chiang et al. 2019 ("Taming the shadow terminator").
float TerminatorShare(float geometric_cosine, float shading_cosine, float between_normals);

}  // namespace quarry

#pragma once

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/kdtree/ray.h"
#include "common/kdtree/voxel_geometry.h"
#include "common/scene/material.h"
#include "common/scene/render_job.h"
#include "common/voxel/block_decoder.h"

// Shading as pure functions of a hit: nothing here knows of voxels, queues or the network.

namespace quarry {

/// What shading knows of the point hit.
struct Surface {
  glm::vec3 position{0};
  glm::vec3 geometric_normal{0};  ///< unit, by the triangle's winding
  glm::vec3 normal{0};            ///< unit, interpolated if the model has normals, turned toward the viewer
  glm::vec2 uv{0};
  glm::vec3 color{1};  ///< vertex colour
  glm::vec3 view{0};   ///< unit, toward where the ray came from
  uint32_t material = 0, part = 0;
  bool entering = true;  ///< the ray meets the side that the winding calls outside
};

/// From the hot block: position, geometric normal, material, part.
Surface MakeSurface(const VoxelGeometry& voxel, const Hit& hit, const glm::vec3& direction);

/// From the shading block: normal, uv, colour.
void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& surface);

/// A light as seen from a point.
struct LightSample {
  glm::vec3 direction{0};  ///< unit, toward the light
  float distance = kInfinity;
  glm::vec3 radiance{0};  ///< falling in
};
LightSample SampleLight(const Light& light, const glm::vec3& position);

/// Light of `light` scattered toward the viewer: Lambert and Blinn-Phong.
glm::vec3 Scatter(const Material& material, const Surface& surface, const LightSample& light);

/// The mirror and the transmitted ray of a surface.
struct Bounces {
  glm::vec3 reflect_weight{0}, refract_weight{0};
  glm::vec3 reflect_direction{0}, refract_direction{0};
};
/// Source: Whitted 1980; Schlick's approximation for materials that ask for Fresnel weights.
Bounces Bounce(const Material& material, const Surface& surface);

/// A colour that tells one voxel from the next (Wald & Slusallek 2001, figure 11).
glm::vec3 VoxelColor(uint32_t voxel);

/// The headlight's part that a surface sends back.
inline float Facing(const Surface& s) { return glm::abs(glm::dot(s.normal, s.view)); }

/// How much of the ambient light a surface sends back: more where it faces the viewer, so that shapes can be
/// told apart in shadow.
inline float AmbientFactor(const Surface& s) { return 0.4f + 0.6f * Facing(s); }

}  // namespace quarry

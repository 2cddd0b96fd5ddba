#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

#include "common/engine/surfaces/surface.h"
#include "common/scene/surface_properties.h"

// The rays that go on from a surface. Pure functions, thread-safe. Weights are linear RGB.

namespace quarry {

/// The reflected and the transmitted ray of a surface. A ray of weight 0 has no meaningful direction.
struct Bounces {
  glm::vec3 reflect_weight{0}, refract_weight{0};
  glm::vec3 reflect_direction{0}, refract_direction{0};
};
/// Bounces of a ray that hits `surface`. Source: Whitted 1980; Schlick 1994 for materials with Fresnel
/// weights.
Bounces Bounce(const SurfaceProperties& material, const Surface& surface);

/// Whether a bounce of the material can have a weight above 0.
inline bool CanBounce(const SurfaceProperties& m) {
  return m.fresnel || m.reflectance != glm::vec3(0) || m.transmittance != glm::vec3(0);
}

/// The share of a shadow ray's light that a see-through surface lets pass: its transmittance, less the share
/// that a material with Fresnel weights reflects. These are the weights of the transmitted ray, but shadow
/// rays go straight on: no refraction, no total reflection. Each surface counts, so that a solid pane tints
/// twice. `cosine`: between ray and geometric normal, at least 0.
glm::vec3 PassedLight(const SurfaceProperties& material, float cosine);

/// Limit of see-through surfaces that a shadow ray passes; behind more it is dark. Trades rays against light
/// that is missing: each surface takes a ray. A judgement: 32 surfaces are 16 panes of glass.
inline constexpr uint32_t kMostPassed = 32;

/// Limits of bounces: rays of less weight, and rays after so many bounces, are not followed. Trade rays
/// against light that is missing. A judgement: half a step of an 8-bit pixel is 1/510.
inline constexpr float kLeastWeight = 1.0f / 512;
inline constexpr uint32_t kMostBounces = 8;

}  // namespace quarry

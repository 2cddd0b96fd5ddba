#pragma once

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>
#include <numbers>

#include "common/engine/surfaces/surface.h"
#include "common/math/elementary.h"
#include "common/scene/surface_properties.h"
#include "common/scene/view.h"

// The light that surfaces send to the viewer, as pure functions without voxels, queues or the network.
// Thread-safe. Vectors of unit length where not stated otherwise; colours and radiances are linear RGB. The
// functions select instead of branching, so that loops over lanes become vector instructions
// (scatter_packet.h).

namespace quarry {

/// A light as seen from a point.
struct LightSample {
  glm::vec3 direction{0};  ///< toward the light
  float distance = kInfinity;
  glm::vec3 radiance{0};  ///< incoming, in Light's units
};
inline LightSample SampleSun(const Light& light) { return {light.vector, kInfinity, light.radiance}; }
/// The share of a point's light that goes against `direction`, which is toward it: 1 without a cone.
inline float ConeShare(const Light& light, const glm::vec3& direction) {
  const float along = light.cone_offset - glm::dot(light.axis, direction) * light.cone_scale;
  const float cone = std::clamp(along, 0.0f, 1.0f);
  return cone * cone;
}
inline LightSample SamplePoint(const Light& light, const glm::vec3& position) {
  const glm::vec3 to = light.vector - position;
  const float distance2 = std::max(glm::dot(to, to), 1e-20f);
  const float distance = std::sqrt(distance2);
  const glm::vec3 direction = to / distance;
  return {direction, distance, light.radiance / distance2 * ConeShare(light, direction)};
}
/// The light as modes with hard shadows see it: a rectangle is a spot at its centre, of the rectangle's power
/// straight ahead, that falls off by the square of the cosine.
inline Light HardLight(const Light& light) {
  if (light.kind != LightKind::kRectangle) return light;
  constexpr float kPi = std::numbers::pi_v<float>;
  const glm::vec3 cross = glm::cross(light.edges[0], light.edges[1]);
  const float area = std::sqrt(glm::dot(cross, cross));
  Light spot;
  spot.kind = LightKind::kPoint;
  spot.vector = light.vector;
  spot.radiance = light.radiance * (area / kPi);
  spot.axis = cross / area;
  spot.cone_scale = 1;
  spot.cone_offset = 0;
  return spot;
}
inline LightSample SampleLight(const Light& light, const glm::vec3& position) {
  return light.kind == LightKind::kSun ? SampleSun(light) : SamplePoint(HardLight(light), position);
}

/// How a surface scatters and emits light, as an integrator sees it.
struct ScatterProperties {
  glm::vec3 albedo, emission, specular;
  float shininess;  ///< of the highlight; 0: there is none
  bool unlit;       ///< no light counts, and the albedo is 0; vertex colours multiply the emission
};
/// The colour of a surface that scatters light: BaseColor(), DiffuseColor() or StudioColor().
using AlbedoOf = glm::vec3 (*)(const SurfaceProperties&);

/// For paths that end at the first surface: metals, mirrors and glass are not black; opacity is ignored.
inline glm::vec3 BaseColor(const SurfaceProperties& m) { return m.base_color; }
/// For paths that go on with reflected and transmitted rays.
inline glm::vec3 DiffuseColor(const SurfaceProperties& m) { return m.diffuse; }
/// For a studio's light, which uses neither colour: mirrors and glass count by the light that they send on,
/// and no surface is so dark that its shape is lost.
inline glm::vec3 StudioColor(const SurfaceProperties& m) {
  constexpr float kMirror = 0.8f, kDarkest = 0.03f;
  const glm::vec3 sent_on = glm::min(m.reflectance + m.transmittance + m.specular, glm::vec3(1)) * kMirror;
  return glm::max(glm::max(m.base_color, sent_on), glm::vec3(kDarkest));
}

inline ScatterProperties ScatterOf(const SurfaceProperties& m, AlbedoOf albedo) {
  const bool highlight = m.shininess > 0 && m.specular != glm::vec3(0);
  return {m.unlit ? glm::vec3(0) : albedo(m), m.emission, m.specular, highlight ? m.shininess : 0.0f,
          m.unlit};
}

/// Radiance emitted.
inline glm::vec3 Emitted(const ScatterProperties& p, const Surface& s) {
  return Choose(p.unlit, p.emission * s.color, p.emission);
}

/// Radiance of a light that a surface scatters toward the viewer: Lambert, and with `kHighlight` Blinn-Phong.
/// Source: Blinn 1977 (half vector).
template <bool kHighlight>
[[gnu::always_inline]] inline glm::vec3 Scatter(const ScatterProperties& p, const Surface& s,
                                                const LightSample& light) {
  const float cosine = glm::dot(s.normal, light.direction);
  glm::vec3 weight = p.albedo * s.color * cosine;
  if constexpr (kHighlight) {
    const float half_cosine = glm::dot(s.normal, Unit(light.direction + s.view));
    weight += p.specular * static_cast<float>(Pow(std::max(half_cosine, 0.0f), p.shininess));
  }
  return Choose(cosine > 0, weight * light.radiance, glm::vec3(0));
}
/// The same for a surface that may have a highlight.
inline glm::vec3 Scatter(const ScatterProperties& p, const Surface& s, const LightSample& light) {
  return p.shininess > 0 ? Scatter<true>(p, s, light) : Scatter<false>(p, s, light);
}

/// Share of the headlight that a white surface scatters to the viewer: the cosine.
inline float Facing(const Surface& s) { return std::fabs(glm::dot(s.normal, s.view)); }

/// Radiance to the viewer by the headlight and by emission.
inline glm::vec3 UnderHeadlight(const ScatterProperties& p, const Surface& s) {
  return p.albedo * s.color * Facing(s) + Emitted(p, s);
}

/// Share of the ambient light that a white surface scatters to the viewer. It is greater where the surface
/// faces the viewer, so that shapes are visible in shadow.
inline float AmbientFactor(const Surface& s) { return 0.4f + 0.6f * Facing(s); }

/// Radiance to the viewer by ambient light and by emission.
inline glm::vec3 UnderAmbient(const ScatterProperties& p, const glm::vec3& ambient, const Surface& s) {
  return p.albedo * s.color * ambient * AmbientFactor(s) + Emitted(p, s);
}

/// The light that a white surface sends back of a headlight and of a soft dome, brighter at its zenith `up`.
inline float StudioFactor(const Surface& s, const glm::vec3& up) {
  constexpr float kHeadlight = 0.6f, kDome = 0.4f, kNadir = 0.1f;
  const float height = 0.5f + 0.5f * glm::dot(s.normal, up);
  const float facing = Facing(s);
  return kHeadlight * facing * facing + kDome * (kNadir + (1 - kNadir) * height);
}

/// Part of the studio's light that nothing occludes, so that crevices keep their shapes.
inline constexpr float kOpenShare = 0.15f;
/// Part of the studio's light that each of `rays` occlusion rays adds if nothing is in its way.
inline float OcclusionShare(uint32_t rays) { return (1 - kOpenShare) / static_cast<float>(rays); }

}  // namespace quarry

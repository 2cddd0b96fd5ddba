#include "common/scene/scene_views.h"

#include <algorithm>
#include <cmath>

namespace quarry {
namespace {

template <class V>
bool IsFinite(const V& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

}  // namespace

bool IsSane(const CameraSpec& c) {
  return IsFinite(c.eye) && IsFinite(c.at) && IsFinite(c.up) && c.eye != c.at && c.fov_degrees > 0 &&
         c.fov_degrees <= 179 && c.ortho_height >= 0 && std::isfinite(c.ortho_height);
}

bool IsSane(const NamedLight& l) {
  const auto cosine = [](float x) { return x >= -1 && x <= 1; };
  const bool flat = l.kind == LightKind::kRectangle;
  if (flat && (!IsFinite(l.edges[0]) || !IsFinite(l.edges[1]) || !HasArea(l.edges))) return false;
  return (flat || l.kind <= LightKind::kPoint) && IsFinite(l.position) && IsFinite(l.direction) &&
         l.direction != glm::vec3(0) && IsFinite(l.radiance) && l.radiance.x >= 0 && l.radiance.y >= 0 &&
         l.radiance.z >= 0 && cosine(l.cos_inner) && cosine(l.cos_outer) && l.cos_outer <= l.cos_inner;
}

Light ToLight(const NamedLight& light, const glm::dvec3& offset) {
  Light out;
  out.kind = light.kind;
  out.radiance = light.radiance;
  if (light.kind == LightKind::kSun) {
    out.vector = light.direction;
    return out;
  }
  out.vector = glm::vec3(light.position - offset);
  if (light.kind == LightKind::kRectangle) {
    std::copy_n(light.edges, 2, out.edges);
    return out;
  }
  if (light.cos_outer <= -1) return out;
  out.axis = light.direction;
  out.cone_scale = 1 / std::max(light.cos_inner - light.cos_outer, 0.001f);
  out.cone_offset = -light.cos_outer * out.cone_scale;
  return out;
}

}  // namespace quarry

#include "common/engine/integrators/bounce.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

namespace quarry {
namespace {

float SchlickPower(float cosine) {
  const float m = std::clamp(1.0f - cosine, 0.0f, 1.0f);
  return m * m * m * m * m;
}

/// The reflected share at a surface that reflects and transmits. Source: Schlick 1994.
float FresnelShare(const SurfaceProperties& material, float cosine) {
  const float root = (material.specular_ior - 1) / (material.specular_ior + 1), f0 = root * root;
  return f0 + (1 - f0) * SchlickPower(cosine);
}

}  // namespace

Bounces Bounce(const SurfaceProperties& material, const Surface& s) {
  Bounces b;
  const float cosine = std::clamp(glm::dot(s.normal, s.view), 0.0f, 1.0f);
  b.reflect_direction = Unit(s.normal * (2 * cosine) - s.view);
  b.reflect_weight = material.reflectance;
  b.refract_weight = material.transmittance;
  const bool transmits = material.transmittance != glm::vec3(0);
  if (material.fresnel && transmits) {
    const float fresnel = FresnelShare(material, cosine);
    b.reflect_weight = glm::vec3(fresnel);
    b.refract_weight *= 1 - fresnel;
  } else if (material.fresnel) {
    b.reflect_weight += (glm::vec3(1) - b.reflect_weight) * SchlickPower(cosine);
  }
  if (!transmits) return b;
  const float eta = s.entering ? 1 / material.ior : material.ior;
  const float sine2 = eta * eta * (1 - cosine * cosine);
  if (sine2 >= 1) {  // total internal reflection
    b.reflect_weight = glm::max(material.reflectance, material.transmittance);
    b.refract_weight = glm::vec3(0);
    return b;
  }
  b.refract_direction = Unit(s.normal * (eta * cosine - std::sqrt(1 - sine2)) - s.view * eta);
  return b;
}

glm::vec3 PassedLight(const SurfaceProperties& material, float cosine) {
  return material.fresnel ? material.transmittance * (1 - FresnelShare(material, cosine))
                          : material.transmittance;
}

}  // namespace quarry

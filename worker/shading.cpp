#include "worker/shading.h"

#include <algorithm>
#include <cmath>

#include "common/math/elementary.h"
#include "common/math/random.h"

namespace quarry {
namespace {

glm::vec3 Unit(const glm::vec3& v) {
  const float length = std::sqrt(glm::dot(v, v));
  return length > 0 ? v / length : glm::vec3(0, 0, 1);
}

float SchlickPower(float cosine) {
  const float m = std::clamp(1.0f - cosine, 0.0f, 1.0f);
  return m * m * m * m * m;
}

}  // namespace

Surface MakeSurface(const VoxelGeometry& voxel, const Hit& hit, const glm::vec3& direction) {
  const glm::vec3& p0 = voxel.vertex(hit.local, 0);
  const glm::vec3& p1 = voxel.vertex(hit.local, 1);
  const glm::vec3& p2 = voxel.vertex(hit.local, 2);
  Surface s;
  s.position = p0 * (1 - hit.b1 - hit.b2) + p1 * hit.b1 + p2 * hit.b2;
  // In double: slender triangles lose their direction in float.
  const glm::dvec3 n = glm::cross(glm::dvec3(p1) - glm::dvec3(p0), glm::dvec3(p2) - glm::dvec3(p0));
  const double length = std::sqrt(glm::dot(n, n));
  s.geometric_normal = length > 0 ? glm::vec3(n / length) : glm::vec3(0, 0, 1);
  s.view = -direction;
  s.entering = glm::dot(s.geometric_normal, direction) < 0;
  s.normal = s.entering ? s.geometric_normal : -s.geometric_normal;
  s.material = voxel.materials[hit.local];
  s.part = voxel.parts[hit.local];
  return s;
}

void AddAttributes(const VoxelShading& shading, const Hit& hit, Surface& s) {
  const ShadingVertex& a = shading.vertex(hit.local, 0);
  const ShadingVertex& b = shading.vertex(hit.local, 1);
  const ShadingVertex& c = shading.vertex(hit.local, 2);
  const float b0 = 1 - hit.b1 - hit.b2;
  const auto color = [](uint32_t packed) {
    return glm::vec3(static_cast<float>(packed & 255), static_cast<float>(packed >> 8 & 255),
                     static_cast<float>(packed >> 16 & 255)) /
           255.0f;
  };
  s.color = color(a.color) * b0 + color(b.color) * hit.b1 + color(c.color) * hit.b2;
  s.uv = a.uv * b0 + b.uv * hit.b1 + c.uv * hit.b2;
  const glm::vec3 n = a.normal * b0 + b.normal * hit.b1 + c.normal * hit.b2;
  if (!(glm::dot(n, n) > 1e-12f)) return;
  const glm::vec3 unit = Unit(n);
  // Turned to the geometric side that is seen; where interpolation bends it away from the viewer, the
  // geometric one stands in.
  const glm::vec3 turned = glm::dot(unit, s.normal) < 0 ? -unit : unit;
  if (glm::dot(turned, s.view) > 0) s.normal = turned;
}

LightSample SampleLight(const Light& light, const glm::vec3& position) {
  if (light.kind == LightKind::kSun) return {light.vector, kInfinity, light.radiance};
  const glm::vec3 to = light.vector - position;
  const float distance2 = std::max(glm::dot(to, to), 1e-20f);
  const float distance = std::sqrt(distance2);
  return {to / distance, distance, light.radiance / distance2};
}

glm::vec3 Scatter(const Material& material, const Surface& s, const LightSample& light) {
  const float cosine = glm::dot(s.normal, light.direction);
  if (!(cosine > 0)) return glm::vec3(0);
  glm::vec3 weight = material.diffuse * s.color * cosine;
  if (material.shininess > 0 && material.specular != glm::vec3(0)) {
    const float half_cosine = glm::dot(s.normal, Unit(light.direction + s.view));
    weight += material.specular * static_cast<float>(Pow(std::max(half_cosine, 0.0f), material.shininess));
  }
  return weight * light.radiance;
}

Bounces Bounce(const Material& material, const Surface& s) {
  Bounces b;
  const float cosine = std::clamp(glm::dot(s.normal, s.view), 0.0f, 1.0f);
  b.reflect_direction = Unit(s.normal * (2 * cosine) - s.view);
  b.reflect_weight = material.reflectance;
  b.refract_weight = material.transmittance;
  const bool transmits = material.transmittance != glm::vec3(0);
  float fresnel = 0;
  if (material.fresnel && transmits) {
    const float f0 = (material.ior - 1) / (material.ior + 1) * ((material.ior - 1) / (material.ior + 1));
    fresnel = f0 + (1 - f0) * SchlickPower(cosine);
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

glm::vec3 VoxelColor(uint32_t voxel) {
  const uint64_t h = Mix64(voxel + 0x9E3779B97F4A7C15ull);
  const auto channel = [&](int shift) {
    return 0.25f + 0.75f * static_cast<float>(h >> shift & 255) / 255.0f;
  };
  return {channel(0), channel(8), channel(16)};
}

}  // namespace quarry

#include "common/scene/open_pbr.h"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>

namespace quarry {
namespace {

float Most(const glm::vec3& v) { return std::max({v.x, v.y, v.z}); }

glm::vec3 AtMostOne(const glm::vec3& v) {
  return {std::min(v.x, 1.0f), std::min(v.y, 1.0f), std::min(v.z, 1.0f)};
}

/// False for NaN.
bool Within(float value, float low, float high) { return value >= low && value <= high; }

template <class Properties>
void ToWhitted(Properties& m, bool bends) {
  const float there = m.geometry_opacity, metal = m.base_metalness, passes = m.transmission_weight;
  const float smooth = (1 - m.specular_roughness) * (1 - m.specular_roughness);
  m.specular = m.reflectance = glm::vec3(0);
  m.transmittance = glm::vec3(1 - there);
  m.ior = 1;
  m.shininess = 0;
  m.fresnel = false;
  if (m.unlit) {
    m.diffuse = glm::vec3(0);
    m.emission = m.base_color * there;
    return;
  }
  m.diffuse = m.base_color * (there * ((1 - metal) * (1 - passes) + metal * (1 - smooth)));
  const glm::vec3 tint = m.transmission_depth > 0 ? m.base_color : m.transmission_color;
  m.transmittance += tint * (there * (1 - metal) * passes);
  m.reflectance = m.base_color * (there * metal * smooth);
  const float f0 = (m.specular_ior - 1) / (m.specular_ior + 1);
  m.specular = AtMostOne(m.base_color * (there * metal * (1 - smooth)) +
                         m.specular_color * (there * m.specular_weight * f0 * f0 * (1 - metal)));
  const float width = std::max(m.specular_roughness * m.specular_roughness, 0.02f);
  m.shininess = std::clamp(2 / (width * width) - 2, 0.0f, 10000.0f);
  if (passes <= 0) return;
  m.fresnel = true;
  if (bends) m.ior = m.specular_ior;
  m.reflectance = AtMostOne(m.reflectance + glm::vec3(there * (1 - metal) * smooth));
}

template <class Properties>
void SetHighlight(Properties& m, const glm::vec3& specular) {
  const float mean = (specular.x + specular.y + specular.z) / 3;
  m.specular_weight = std::min(2 * mean, 1.0f);
  m.specular_color = mean > 0 ? specular / Most(specular) : glm::vec3(1);
  const float root = std::sqrt(0.08f * std::clamp(mean, 0.5f, 1.0f));
  m.specular_ior = mean > 0.5f ? (1 + root) / (1 - root) : 1.5f;
}

}  // namespace

void SetHighlight(SurfaceProperties& m, const glm::vec3& specular) {
  SetHighlight<SurfaceProperties>(m, specular);
}

void DeriveOpenPbr(Material& m) {
  const float passes = Most(m.transmittance), mirror = Most(m.reflectance), matte = Most(m.diffuse);
  const bool glass = passes > 0 && (m.fresnel || m.ior > 1);
  const bool mirrors = mirror > 0 && !(glass && m.fresnel);
  glm::vec3 color = m.diffuse;
  m.geometry_opacity = passes > 0 && !glass ? 1 - passes : 1.0f;
  if (m.geometry_opacity > 0) color /= m.geometry_opacity;
  if (mirrors) color += m.reflectance;
  if (glass) color += m.transmittance;
  m.base_color = AtMostOne(color);
  m.base_metalness = mirrors ? mirror / (mirror + matte) : 0.0f;
  const bool highlight = m.shininess > 0 && Most(m.specular) > 0;
  // The exponent of Blinn's highlight is 2 / alpha^2 - 2, and alpha is the square of the roughness.
  m.specular_roughness =
      m.shininess > 0 || !(mirrors || glass) ? std::sqrt(std::sqrt(2 / (m.shininess + 2))) : 0.0f;
  m.specular_weight = mirrors || glass ? 1.0f : 0.0f;
  m.specular_color = glm::vec3(1);
  m.specular_ior = glass ? m.ior : 1.5f;
  if (highlight && !mirrors && !glass) SetHighlight(m, m.specular);
  m.transmission_weight = glass ? passes : 0.0f;
  m.transmission_color = glass ? m.transmittance / passes : glm::vec3(1);
  m.transmission_depth = 0;
  m.is_open_pbr = false;
}

void DeriveWhitted(Material& m, bool bends) {
  ToWhitted(m, bends);
  m.is_open_pbr = true;
}
void DeriveWhitted(SurfaceProperties& m, bool bends) { ToWhitted(m, bends); }

bool AgreesWithOpenPbr(const Material& m) {
  SurfaceProperties d(m);
  DeriveWhitted(d, m.ior > 1);
  return d.diffuse == m.diffuse && d.specular == m.specular && d.reflectance == m.reflectance &&
         d.transmittance == m.transmittance && d.emission == m.emission && d.shininess == m.shininess &&
         d.ior == m.ior && d.fresnel == m.fresnel;
}

bool IsSane(const Material& m) {
  for (const glm::vec3* c : {&m.diffuse, &m.specular, &m.reflectance, &m.transmittance, &m.base_color,
                             &m.specular_color, &m.transmission_color})
    for (int a = 0; a < 3; ++a)
      if (!Within((*c)[a], 0, 1)) return false;
  constexpr float kLargest = std::numeric_limits<float>::max();
  for (int a = 0; a < 3; ++a)
    if (!Within(m.emission[a], 0, kLargest)) return false;
  for (const float x :
       {m.base_metalness, m.specular_roughness, m.specular_weight, m.transmission_weight, m.geometry_opacity})
    if (!Within(x, 0, 1)) return false;
  return Within(m.shininess, 0, 10000) && Within(m.ior, 1, 10) && Within(m.specular_ior, 1, 10) &&
         Within(m.transmission_depth, 0, kLargest);
}

}  // namespace quarry

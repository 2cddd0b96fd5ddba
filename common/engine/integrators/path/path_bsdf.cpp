#include "common/engine/integrators/path/path_bsdf.h"

#include <algorithm>
#include <cmath>
#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <numbers>

#include "common/engine/integrators/path/albedo_tables.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
/// Half angle of a cosine lobe, for cones. A judgement: half of its light lies within.
constexpr float kMattWidth = 0.5f;

float Mean(const glm::vec3& v) { return (v.x + v.y + v.z) / 3; }

float FifthPower(float x) { return x * x * x * x * x; }

/// Means of reflected shares over a hemisphere, by the cosine: of a boundary to a medium with an index above
/// 1, and of the part of Schlick's curve that rises toward the edge. Source: Kulla & Conty 2017, a fit.
float MeanFresnel(float ior) { return (ior - 1) / (4.08567f + 1.00071f * ior); }
constexpr float kMeanEdge = 1 / 21.0f;

/// `view` mirrored at a normal, on the outer side of the surface: if that lies inside, mirrored out of it.
glm::vec3 Mirrored(const glm::vec3& view, const glm::vec3& normal, const glm::vec3& side) {
  const glm::vec3 mirrored = normal * (2 * glm::dot(normal, view)) - view;
  const float into = glm::dot(mirrored, side);
  return Unit(into > 0 ? mirrored : mirrored - side * (2 * into));
}

glm::vec3 SideOf(const Surface& s) { return s.entering ? s.geometric_normal : -s.geometric_normal; }

}  // namespace

float TerminatorShare(float geometric_cosine, float shading_cosine, float between_normals) {
  const float g = geometric_cosine / std::max(shading_cosine * between_normals, 1e-9f);
  return g >= 1 ? 1.0f : g * (1 + g * (1 - g));
}

PathBsdf::PathBsdf(const SurfaceProperties& m, const Surface& s) : normal_(s.normal), side_(SideOf(s)) {
  Tangents(normal_, tangent_, bitangent_);
  view_ = ToLocal(s.view);
  view_.z = std::max(view_.z, 1e-4f);
  const glm::vec3 base = glm::min(m.base_color * s.color, glm::vec3(1));
  const float roughness = m.specular_roughness, metal = m.base_metalness;
  alpha_ = roughness * roughness;
  ior_ = m.specular_ior;
  metal_ = base * metal;
  metal_edge_ = glm::vec3(metal) - metal_;
  layer_ = m.specular_color * (m.specular_weight * (1 - metal));
  const AlbedoTables& tables = AlbedoTables::Get();
  const float of_facets = is_mirror() ? 1.0f : tables.Reflected(view_.z, roughness);
  const float missing = (1 - of_facets) / of_facets;
  // Light that facets meet again meets them at all angles.
  const glm::vec3 met_again = metal_ + metal_edge_ * kMeanEdge + layer_ * MeanFresnel(ior_);
  made_up_ = glm::vec3(1) + met_again * missing;
  const float of_layer = is_mirror() ? FresnelOf(view_.z, ior_) : tables.Dielectric(view_.z, roughness, ior_);
  const glm::vec3 taken = glm::min(layer_ * made_up_ * of_layer, glm::vec3(1));
  matt_ = base * (glm::vec3(1) - taken) * (1 - metal);
  const float facets = Mean((metal_ + metal_edge_ * FifthPower(1 - view_.z)) + taken), body = Mean(matt_);
  specular_chance_ = facets + body > 0 ? facets / (facets + body) : 0;
  // Neither lobe becomes so rare that its samples weigh much.
  if (facets > 0 && body > 0) specular_chance_ = std::clamp(specular_chance_, 0.1f, 0.9f);
}

glm::vec3 PathBsdf::Reflected(float toward) const {
  return metal_ + metal_edge_ * FifthPower(std::max(1 - toward, 0.0f)) + layer_ * FresnelOf(toward, ior_);
}

PathBsdf::Scattered PathBsdf::Toward(const glm::vec3& light) const { return Toward(light, ToLocal(light)); }

PathBsdf::Scattered PathBsdf::Toward(const glm::vec3& world, const glm::vec3& light) const {
  const float geometric = glm::dot(world, side_);
  if (!(geometric > 0) || !(light.z > 0)) return {};
  Scattered all{matt_ * (light.z / kPi), (1 - specular_chance_) * light.z / kPi};
  if (!is_mirror() && specular_chance_ > 0) {
    const glm::vec3 half = glm::normalize(light + view_);
    const Ggx ggx(alpha_);
    const float density = ggx.Density(view_, half);
    all.weight += Reflected(glm::dot(half, view_)) * made_up_ * (density * ggx.ShareSeen(view_.z, light.z));
    all.density += specular_chance_ * density;
  }
  all.weight *= TerminatorShare(geometric, light.z, glm::dot(side_, normal_));
  return all;
}

PathBsdf::Sample PathBsdf::SampleDirection(const glm::vec2& u, float choice) const {
  if (specular_chance_ == 0 && matt_ == glm::vec3(0)) return {};
  const bool specular = choice < specular_chance_;
  if (specular && is_mirror())
    return {Mirrored(ToWorld(view_), normal_, side_), Reflected(view_.z) / specular_chance_, 0, 0};
  glm::vec3 light;
  if (specular) {
    const glm::vec3 facet = Ggx(alpha_).Facet(view_, u);
    light = facet * (2 * glm::dot(view_, facet)) - view_;
  } else {
    const glm::vec2 disk = ConcentricDisk(u);
    light = {disk.x, disk.y, std::sqrt(std::max(1 - glm::dot(disk, disk), 0.0f))};
  }
  const glm::vec3 world = Unit(ToWorld(light));
  const Scattered all = Toward(world, light);
  if (!(all.density > 0)) return {};
  return {world, all.weight / all.density, all.density, specular ? std::min(alpha_, kMattWidth) : kMattWidth};
}

glm::vec3 MirrorDirection(const Surface& s) { return Mirrored(s.view, s.normal, SideOf(s)); }

GlassRay ThroughGlass(const SurfaceProperties& m, const Surface& s, float choice) {
  const bool is_pane = m.ior <= 1;
  const float cosine = std::clamp(glm::dot(s.normal, s.view), 0.0f, 1.0f);
  const float index = s.entering || is_pane ? m.specular_ior : 1 / m.specular_ior;
  if (choice < FresnelOf(cosine, index)) return {MirrorDirection(s), glm::vec3(1), false};
  const glm::vec3 tint = m.transmission_depth > 0 ? m.base_color : m.transmission_color;
  if (is_pane) return {-s.view, tint, true};
  const float eta = 1 / index, inner2 = std::max(1 - eta * eta * (1 - cosine * cosine), 0.0f);
  return {Unit(s.normal * (eta * cosine - std::sqrt(inner2)) - s.view * eta), tint, true};
}

Passing PassingOf(const SurfaceProperties& m, float cosine, bool has_map, bool is_hidden) {
  Passing p;
  const float there = has_map ? 1.0f : m.geometry_opacity;
  p.hole = 1 - there;
  p.glass = there * (1 - m.base_metalness) * m.transmission_weight;
  if (m.ior > 1 || is_hidden) return p;
  p.pane = p.glass * (1 - FresnelOf(std::min(cosine, 1.0f), m.specular_ior));
  p.glass -= p.pane;
  p.tint = m.transmission_depth > 0 ? m.base_color : m.transmission_color;
  return p;
}

}  // namespace quarry

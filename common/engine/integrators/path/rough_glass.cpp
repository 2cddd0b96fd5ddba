#include "common/engine/integrators/path/rough_glass.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>

#include "common/engine/integrators/path/albedo_tables.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

/// The root of the share that is mirrored at normal incidence, with its sign, for the table's last index, 10.
constexpr float kLastSigned = 9.0f / 11;

float SignedRootOf(float index) { return (index - 1) / (index + 1); }
float IndexOfSigned(float root) { return (1 + root) / (1 - root); }

/// The direction to which a facet refracts light toward the viewer. Requires: it does not mirror all.
glm::vec3 RefractedAt(const glm::vec3& facet, const glm::vec3& view, float index) {
  const float eta = 1 / index, toward = glm::dot(view, facet);
  const float inner2 = std::max(1 - eta * eta * (1 - toward * toward), 0.0f);
  return facet * (eta * toward - std::sqrt(inner2)) - view * eta;
}

glm::vec3 MirroredAt(const glm::vec3& facet, const glm::vec3& view) {
  return facet * (2 * glm::dot(view, facet)) - view;
}

}  // namespace

RoughGlass::RoughGlass(const SurfaceProperties& m, const Surface& s)
    : normal_(s.normal),
      side_(s.entering ? s.geometric_normal : -s.geometric_normal),
      tint_(m.transmission_depth > 0 ? m.base_color : m.transmission_color),
      alpha_(m.specular_roughness * m.specular_roughness),
      index_(s.entering ? m.specular_ior : 1 / m.specular_ior) {
  Tangents(normal_, tangent_, bitangent_);
  view_ = {glm::dot(s.view, tangent_), glm::dot(s.view, bitangent_), glm::dot(s.view, normal_)};
  view_.z = std::max(view_.z, 1e-4f);
  scale_ = 1 / GlassTable::Get().SentOn(view_.z, m.specular_roughness, index_);
}

PathBsdf::Scattered RoughGlass::Mirrored(const glm::vec3& light) const {
  const Ggx ggx(alpha_);
  const glm::vec3 facet = glm::normalize(light + view_);
  const float density = FresnelOf(glm::dot(view_, facet), index_) * ggx.Density(view_, facet);
  return {glm::vec3(density * ggx.ShareSeen(view_.z, light.z) * scale_), density};
}

PathBsdf::Scattered RoughGlass::Refracted(const glm::vec3& light) const {
  const Ggx ggx(alpha_);
  glm::vec3 facet = -(view_ + light * index_);
  if (facet.z < 0) facet = -facet;
  if (!(glm::dot(facet, facet) > 1e-18f)) return {};
  facet = glm::normalize(facet);
  const float toward = glm::dot(view_, facet), behind = glm::dot(light, facet);
  if (!(toward > 0) || !(behind < 0) || !(facet.z > 0)) return {};
  const float passes = 1 - FresnelOf(toward, index_), across = toward + index_ * behind;
  const float spread = index_ * index_ * -behind / std::max(across * across, 1e-18f);
  const float density = passes * 4 * toward * ggx.Density(view_, facet) * spread;
  return {tint_ * (density * ggx.ShareThrough(-light.z) * scale_), density};
}

PathBsdf::Scattered RoughGlass::Toward(const glm::vec3& world) const {
  const glm::vec3 light{glm::dot(world, tangent_), glm::dot(world, bitangent_), glm::dot(world, normal_)};
  const float geometric = glm::dot(world, side_);
  if (light.z > 0 && geometric > 0) return Mirrored(light);
  if (light.z < 0 && geometric < 0) return Refracted(light);
  return {};
}

PathBsdf::Sample RoughGlass::SampleDirection(const glm::vec2& u, float choice) const {
  const glm::vec3 facet = Ggx(alpha_).Facet(view_, u);
  const bool mirrors = choice < FresnelOf(glm::dot(view_, facet), index_);
  const glm::vec3 light = mirrors ? MirroredAt(facet, view_) : RefractedAt(facet, view_, index_);
  const glm::vec3 world = Unit(tangent_ * light.x + bitangent_ * light.y + normal_ * light.z);
  if (mirrors != (light.z > 0)) return {};
  const PathBsdf::Scattered all = Toward(world);
  if (!(all.density > 0)) return {};
  return {world, all.weight / all.density, all.density, alpha_};
}

const GlassTable& GlassTable::Get() {
  static const GlassTable kTable;
  return kTable;
}

/// As AlbedoTables are made.
GlassTable::GlassTable() : shares_(size_t{kIndices} * kSide * kSide) {
  constexpr uint32_t kPoints = 512;
  for (uint32_t i = 0; i < kIndices; ++i)
    for (uint32_t r = 0; r < kSide; ++r)
      for (uint32_t c = 0; c < kSide; ++c) {
        const float index = IndexOfSigned(kLastSigned * (2 * static_cast<float>(i) / (kIndices - 1) - 1));
        const float roughness = static_cast<float>(r) / (kSide - 1),
                    root = static_cast<float>(c) / (kSide - 1);
        const float cosine = std::max(root * root, 1e-4f);
        const glm::vec3 view(std::sqrt(1 - cosine * cosine), 0, cosine);
        const Ggx ggx(std::max(roughness * roughness, 1e-4f));
        double sum = 0;
        for (uint32_t point = 0; point < kPoints; ++point) {
          const glm::vec2 u((static_cast<float>(point) + 0.5f) / kPoints,
                            static_cast<float>(Sobol2(point)) * 0x1p-32f + 0.5f / kPoints);
          const glm::vec3 facet = ggx.Facet(view, u), mirrored = MirroredAt(facet, view);
          const float mirrors = FresnelOf(glm::dot(view, facet), index);
          if (mirrored.z > 0) sum += static_cast<double>(mirrors * ggx.ShareSeen(view.z, mirrored.z));
          if (!(mirrors < 1)) continue;
          const glm::vec3 refracted = RefractedAt(facet, view, index);
          if (refracted.z < 0) sum += static_cast<double>((1 - mirrors) * ggx.ShareThrough(-refracted.z));
        }
        shares_[(i * kSide + r) * kSide + c] = static_cast<float>(sum / kPoints);
      }
}

float GlassTable::SentOn(float cosine, float roughness, float index) const {
  const float z = std::clamp((SignedRootOf(index) / kLastSigned + 1) / 2, 0.0f, 1.0f) * (kIndices - 1);
  const uint32_t table = std::min(static_cast<uint32_t>(z), kIndices - 2);
  const float* const at = &shares_[size_t{table} * kSide * kSide];
  const float before = ShareOfTable(at, kSide, cosine, roughness);
  const float behind = ShareOfTable(at + kSide * kSide, kSide, cosine, roughness);
  return std::max(before + (behind - before) * (z - static_cast<float>(table)), 0.1f);
}

}  // namespace quarry

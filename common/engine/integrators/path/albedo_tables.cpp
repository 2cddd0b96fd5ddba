#include "common/engine/integrators/path/albedo_tables.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>

#include "common/engine/integrators/path/ggx.h"

namespace quarry {
namespace {

/// The root of the share that is reflected at normal incidence, for the last index of the tables, 10.
constexpr float kLastRoot = 9.0f / 11;

float IndexOf(float root) { return (1 + root) / (1 - root); }

}  // namespace

float FresnelOf(float cosine, float ior) {
  const float g2 = ior * ior - 1 + cosine * cosine;
  if (!(g2 > 0)) return 1;
  const float g = std::sqrt(g2), a = (g - cosine) / (g + cosine);
  const float b = (cosine * (g + cosine) - 1) / (cosine * (g - cosine) + 1);
  return 0.5f * a * a * (1 + b * b);
}

float ShareOfTable(const float* table, uint32_t side, float cosine, float roughness) {
  const float x = std::sqrt(std::clamp(cosine, 0.0f, 1.0f)) * static_cast<float>(side - 1);
  const float y = std::clamp(roughness, 0.0f, 1.0f) * static_cast<float>(side - 1);
  const uint32_t column = std::min(static_cast<uint32_t>(x), side - 2);
  const uint32_t row = std::min(static_cast<uint32_t>(y), side - 2);
  const float across = x - static_cast<float>(column), down = y - static_cast<float>(row);
  const float* at = table + row * side + column;
  const float upper = at[0] + (at[1] - at[0]) * across;
  const float lower = at[side] + (at[side + 1] - at[side]) * across;
  return upper + (lower - upper) * down;
}

const AlbedoTables& AlbedoTables::Get() {
  static const AlbedoTables kTables;
  return kTables;
}

/// Each node is a mean over facets, chosen as Ggx::Facet() does, at the points of a Hammersley set: a square
/// grid of as many is ten times less exact. Directions lie evenly by the root of their cosine, since shares
/// change most where light grazes.
AlbedoTables::AlbedoTables() : shares_(size_t{kIndices + 1} * kSide * kSide) {
  constexpr uint32_t kPoints = 1024;
  for (uint32_t r = 0; r < kSide; ++r)
    for (uint32_t c = 0; c < kSide; ++c) {
      const float roughness = static_cast<float>(r) / (kSide - 1), root = static_cast<float>(c) / (kSide - 1);
      const float cosine = std::max(root * root, 1e-4f);
      const glm::vec3 view(std::sqrt(1 - cosine * cosine), 0, cosine);
      const Ggx ggx(std::max(roughness * roughness, 1e-4f));
      double sums[kIndices + 1] = {};
      for (uint32_t point = 0; point < kPoints; ++point) {
        const glm::vec2 u((static_cast<float>(point) + 0.5f) / kPoints,
                          static_cast<float>(Sobol2(point)) * 0x1p-32f + 0.5f / kPoints);
        const glm::vec3 facet = ggx.Facet(view, u);
        const float toward = glm::dot(view, facet);
        const glm::vec3 light = facet * (2 * toward) - view;
        if (!(light.z > 0)) continue;
        const double share = ggx.ShareSeen(view.z, light.z);
        for (uint32_t i = 0; i < kIndices; ++i)
          sums[i] += share * FresnelOf(toward, IndexOf(kLastRoot * static_cast<float>(i) / (kIndices - 1)));
        sums[kFull] += share;
      }
      for (uint32_t i = 0; i <= kIndices; ++i)
        shares_[(i * kSide + r) * kSide + c] = static_cast<float>(sums[i] / kPoints);
    }
}

/// A parabola through three tables: shares bend with the index where light grazes.
float AlbedoTables::Dielectric(float cosine, float roughness, float ior) const {
  const float root = (ior - 1) / (ior + 1), z = std::clamp(root / kLastRoot, 0.0f, 1.0f) * (kIndices - 1);
  const uint32_t middle = std::clamp(static_cast<uint32_t>(z + 0.5f), 1u, kIndices - 2);
  const float before = At(middle - 1, cosine, roughness), here = At(middle, cosine, roughness);
  const float behind = At(middle + 1, cosine, roughness), off = z - static_cast<float>(middle);
  return here + off * 0.5f * (behind - before + off * (behind - 2 * here + before));
}

}  // namespace quarry

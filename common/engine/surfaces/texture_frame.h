#pragma once

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <glm/vec4.hpp>

#include "common/engine/surfaces/surface.h"
#include "common/math/elementary.h"
#include "common/scene/material.h"

// The position of textures on triangles: derivatives for filters and relief. Pure functions, thread-safe.
// They select instead of branching, so that loops over lanes become vector instructions (texture_packet.h).

namespace quarry {

/// Derivatives of the position by uv along a triangle, and the ratio of areas for filters.
struct TextureFrame {
  glm::vec3 by_u{0}, by_v{0};  ///< zeros where uv does not vary in two directions
  float uv_area = 0;           ///< area of uv over area of the triangle; 1 over squared scene units
};
/// The frame of a triangle with the edges `e1`, `e2` from its first vertex, and the differences of uv along
/// them.
inline TextureFrame FrameOf(const glm::vec3& e1, const glm::vec3& e2, const glm::vec2& d1,
                            const glm::vec2& d2) {
  const float determinant = d1.x * d2.y - d2.x * d1.y;
  const glm::vec3 n = glm::cross(e1, e2);
  const float area = std::sqrt(glm::dot(n, n));
  const bool varies = std::fabs(determinant) > 1e-30f;
  const float scale = varies ? 1 / determinant : 0.0f;
  return {(e1 * d2.y - e2 * d1.y) * scale, (e2 * d1.x - e1 * d2.x) * scale,
          area > 0 ? std::fabs(determinant) / area : 0.0f};
}

/// The curvature of a triangle with the edges `e1`, `e2` and vertex normals `n`: the mean over its edges.
/// Source: Akenine-Moeller et al. 2021 (see LodOf), section 3.
inline float BendingOf(const glm::vec3& e1, const glm::vec3& e2, const glm::vec3& n0, const glm::vec3& n1,
                       const glm::vec3& n2) {
  const auto along = [](const glm::vec3& edge, const glm::vec3& turn) {
    const float length2 = glm::dot(edge, edge);
    return length2 > 0 ? glm::dot(edge, turn) / length2 : 0.0f;
  };
  const float mean = (along(e1, n1 - n0) + along(e2, n2 - n0) + along(e2 - e1, n2 - n1)) / 3;
  return std::fabs(mean) < 1e30f ? mean : 0.0f;
}

/// The level of detail for an image of one texel, where a cone is `width` wide.
/// Source: Akenine-Moeller et al. 2021, "Improved Shader and Texture Level of Detail Using Ray Cones", JCGT
/// 10(1).
inline float LodOf(float uv_area, float width, float cosine) {
  const double least = static_cast<double>(cosine) > 1e-6 ? static_cast<double>(cosine) : 1e-6;
  const double across = static_cast<double>(width) / least;
  return static_cast<float>(Log2(static_cast<double>(uv_area) * across * across) / 2);
}

/// Height of a bump map's full range in texels of the map, times its strength.
inline constexpr float kBumpTexels = 8;
/// A mapped normal that would face away from the viewer is turned until its cosine toward the viewer is about
/// this.
inline constexpr float kLeastFacing = 0.02f;

/// The two axes of an image on a surface: along s, and against t, because t runs down. Of any
/// length.
inline void ImageAxes(const TextureBinding& binding, const glm::vec3& by_u, const glm::vec3& by_v,
                      glm::vec3& right, glm::vec3& up) {
  const auto& a = binding.transform;
  const float sign = a[0] * a[4] - a[1] * a[3] < 0 ? -1.0f : 1.0f;
  right = (by_u * a[4] - by_v * a[3]) * sign;
  up = (by_u * a[1] - by_v * a[0]) * sign;
}

/// The normal at `relief`, a direction in the space of the image's axes and the surface's normal on its outer
/// side. The surface keeps its normal where the image has no axes, or where `relief` has no length.
inline glm::vec3 MappedNormal(const glm::vec3& relief, const glm::vec3& right, const glm::vec3& up,
                              const Surface& s) {
  const glm::vec3 outside = Choose(s.entering, s.normal, -s.normal);
  const glm::vec3 along = right - outside * glm::dot(outside, right);
  const glm::vec3 tangent = Unit(along), other = glm::cross(outside, tangent);
  const glm::vec3 bitangent = Choose(glm::dot(other, up) < 0, -other, other);
  const glm::vec3 mapped = Unit(tangent * relief.x + bitangent * relief.y + outside * relief.z);
  const glm::vec3 seen = Choose(s.entering, mapped, -mapped);
  const float facing = glm::dot(seen, s.view);
  const glm::vec3 turned = Unit(seen + s.view * (kLeastFacing - facing));
  const float length2 = glm::dot(relief, relief);
  const bool is_direction = (static_cast<int>(length2 > 1e-12f) & static_cast<int>(length2 < 1e30f)) != 0;
  const bool has_axes = glm::dot(along, along) > 0;
  const bool maps = (static_cast<int>(is_direction) & static_cast<int>(has_axes)) != 0;
  return Choose(maps, Choose(facing < kLeastFacing, turned, seen), s.normal);
}

/// The direction that a texel of a normal map stands for.
inline glm::vec3 ReliefOfNormal(const glm::vec4& sum, float strength) {
  return {(sum.x * 2 - 1) * strength, (sum.y * 2 - 1) * strength, sum.z * 2 - 1};
}
/// The direction across the slope of a bump map of `width` x `height` texels.
inline glm::vec3 ReliefOfSlope(const glm::vec4& slope, float strength, float width, float height) {
  const float rise = kBumpTexels * strength;
  return {-rise * slope.x / width, rise * slope.y / height, 1};
}

}  // namespace quarry

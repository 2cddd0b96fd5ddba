#pragma once

#include <cstdint>

#include "common/math/host_device.h"

// Cut-outs. A triangle whose opacity comes from a texture is divided in 16 sub-triangles: its edges are
// halved twice. A mask keeps two bits for each, so that most hits need no texel.

namespace quarry {

/// The state of all texels that a lookup in a sub-triangle can touch, at the texture's level 0.
enum class OpacityState : uint32_t {
  kMixed = 0,        ///< look at the texels
  kOpaque = 1,       ///< each is opaque: not below the cut-off; without one, 1 or more
  kTransparent = 2,  ///< each is transparent: below the cut-off; without one, 0 or less
};

inline constexpr uint32_t kSubTriangles = 16;
/// The masks of triangles that are opaque, and transparent, all over. A triangle without an opacity texture
/// has the first.
inline constexpr uint32_t kOpaqueMask = 0x55555555u, kTransparentMask = 0xAAAAAAAAu;

/// The sub-triangle of the point with barycentric weights `b1` and `b2` of the second and third vertex. Each
/// may lie beyond [0, 1] by rounding.
/// Sub-triangles are numbered row by row from the edge between the first and the second vertex, where b2 is
/// 0, and in a row from the edge where b1 is 0; upright and inverted ones take turns. Row r has 7 - 2 r.
QUARRY_HOST_DEVICE inline uint32_t SubTriangleOf(float b1, float b2) {
  const float x = b1 * 4, y = b2 * 4;  // exact
  const auto row = static_cast<uint32_t>(y > 0 ? (y < 3 ? y : 3.0f) : 0.0f);
  const uint32_t most = 3 - row;
  const auto floor = static_cast<uint32_t>(x > 0 ? (x < 3 ? x : 3.0f) : 0.0f);
  const uint32_t column = floor < most ? floor : most;
  const bool inverted = column < most && (x - static_cast<float>(column)) + (y - static_cast<float>(row)) > 1;
  return row * (8 - row) + 2 * column + (inverted ? 1 : 0);
}

/// The state of sub-triangle `sub` in a mask. Requires: sub < kSubTriangles.
QUARRY_HOST_DEVICE inline OpacityState StateOf(uint32_t mask, uint32_t sub) {
  return static_cast<OpacityState>(mask >> (2 * sub) & 3);
}
QUARRY_HOST_DEVICE inline OpacityState StateAt(uint32_t mask, float b1, float b2) {
  return StateOf(mask, SubTriangleOf(b1, b2));
}

/// Whether every state of a mask is one.
inline bool IsMask(uint32_t mask) { return (mask & mask >> 1 & kOpaqueMask) == 0; }

/// Whether rays may pass a triangle: its material's opacity comes from a texture (`is_mapped`), and not all
/// of it is opaque.
QUARRY_HOST_DEVICE inline bool SeeThrough(bool is_mapped, uint32_t mask) {
  return is_mapped && mask != kOpaqueMask;
}

}  // namespace quarry

#pragma once

#include <cstdint>

#include "common/math/host_device.h"

// Cut-outs. A triangle whose opacity comes from a texture is divided in sub-triangles: its edges are divided
// in 4 or 32 equal parts. A mask keeps two bits for each sub-triangle, so that most hits need no texel.

namespace quarry {

/// The state of all texels that a lookup in a sub-triangle can touch, at the texture's level 0.
enum class OpacityState : uint32_t {
  kMixed = 0,        ///< look at the texels
  kOpaque = 1,       ///< each is opaque: not below the cut-off; without one, 1 or more
  kTransparent = 2,  ///< each is transparent: below the cut-off; without one, 0 or less
};

/// Parts of an edge, and sub-triangles, of coarse and of fine masks.
// Finer ones gain little: the edge of an opaque area is two texels wide, since lookups blend texels.
inline constexpr uint32_t kMaskSteps = 4, kFineMaskSteps = 32;
inline constexpr uint32_t kSubTriangles = kMaskSteps * kMaskSteps;
inline constexpr uint32_t kFineSubTriangles = kFineMaskSteps * kFineMaskSteps;

/// The masks of triangles that are opaque, and transparent, all over. A triangle without an opacity texture
/// has the first.
inline constexpr uint32_t kOpaqueMask = 0x55555555u, kTransparentMask = 0xAAAAAAAAu;

/// The sub-triangle of the point with barycentric weights `b1` and `b2` of the second and third vertex. Each
/// may lie beyond [0, 1] by rounding.
/// Sub-triangles are numbered row by row from the edge between the first and the second vertex, where b2 is
/// 0, and in a row from the edge where b1 is 0; upright and inverted ones take turns. Row r has
/// 2 (kSteps - r) - 1.
template <uint32_t kSteps>
QUARRY_HOST_DEVICE inline uint32_t SubTriangleOf(float b1, float b2) {
  constexpr auto kLast = static_cast<float>(kSteps - 1);
  const float x = b1 * kSteps, y = b2 * kSteps;  // exact
  const auto row = static_cast<uint32_t>(y > 0 ? (y < kLast ? y : kLast) : 0.0f);
  const uint32_t most = kSteps - 1 - row;
  const auto floor = static_cast<uint32_t>(x > 0 ? (x < kLast ? x : kLast) : 0.0f);
  const uint32_t column = floor < most ? floor : most;
  const bool inverted = column < most && (x - static_cast<float>(column)) + (y - static_cast<float>(row)) > 1;
  return row * (2 * kSteps - row) + 2 * column + (inverted ? 1 : 0);
}

/// The states of the kFineSubTriangles of a triangle: two bits each, 16 in a word, from the lowest bits on.
struct FineMask {
  uint32_t words[kFineSubTriangles / 16];

  bool operator==(const FineMask&) const = default;
};
static_assert(sizeof(FineMask) == 256, "stored");

/// The states of a triangle in both forms. Fine ones are mixed only where coarse ones are.
struct TriangleMask {
  uint32_t coarse;
  FineMask fine;
};

// The mask of a triangle in a voxel is a word. It holds the states of kSubTriangles, or names one of the
// voxel's fine masks: the top two bits, which are no state, are set then. The next two bits tell which states
// count, opaque below transparent; one that does not count is mixed.

inline constexpr uint32_t kFineMaskTag = 0xF0000000u, kMostFineMasks = 1u << 28;

/// The word that names fine mask `i`. Requires: i < kMostFineMasks.
QUARRY_HOST_DEVICE inline uint32_t NameFineMask(uint32_t i) { return kFineMaskTag | i; }
QUARRY_HOST_DEVICE inline bool NamesFineMask(uint32_t mask) { return mask >> 30 == 3; }
QUARRY_HOST_DEVICE inline uint32_t FineMaskOf(uint32_t mask) { return mask & (kMostFineMasks - 1); }

/// The state of sub-triangle `sub` in a word. Requires: sub < 16, and no fine mask.
QUARRY_HOST_DEVICE inline OpacityState StateOf(uint32_t mask, uint32_t sub) {
  return static_cast<OpacityState>(mask >> (2 * sub) & 3);
}
/// The state of a triangle with this mask at a point. `fine`: the voxel's fine masks.
QUARRY_HOST_DEVICE inline OpacityState StateAt(uint32_t mask, const FineMask* fine, float b1, float b2) {
  if (!NamesFineMask(mask)) return StateOf(mask, SubTriangleOf<kMaskSteps>(b1, b2));
  const uint32_t sub = SubTriangleOf<kFineMaskSteps>(b1, b2);
  const uint32_t counting = mask >> 28 & 3;
  return static_cast<OpacityState>(fine[FineMaskOf(mask)].words[sub / 16] >> (2 * (sub % 16)) & counting);
}
/// The mask with the same holes whose opaque states are mixed.
inline uint32_t OnlyHoles(uint32_t mask) {
  return NamesFineMask(mask) ? mask & ~(1u << 28) : mask & kTransparentMask;
}

/// Whether no state of a word is 3: it names no fine mask, and may be a part of one.
inline bool HoldsStates(uint32_t mask) { return (mask & mask >> 1 & kOpaqueMask) == 0; }
/// Whether a word may be a mask in a voxel with `fine_masks` fine masks, as stored: all states count.
inline bool IsMask(uint32_t mask, uint32_t fine_masks) {
  return HoldsStates(mask) || (mask >= kFineMaskTag && FineMaskOf(mask) < fine_masks);
}

}  // namespace quarry

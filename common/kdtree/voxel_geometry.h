#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec3.hpp>

#include "common/kdtree/node.h"
#include "common/kdtree/opacity_mask.h"
#include "common/kdtree/ray.h"
#include "common/kdtree/wide_node.h"
#include "common/math/host_device.h"

namespace quarry {

/// The corners of a triangle, scene units. Each may be read as four floats.
struct TrianglePoints {
  const float* at[3];
};

/// The hot part of a resident voxel: pointers into one decoded block, valid while the block is pinned. Every
/// index was checked at decode. `Index`: the type of triangles' and vertices' indices in the voxel. Read-only
/// and thread-safe.
template <class Index>
struct VoxelGeometryOf {
  const KdNode* nodes = nullptr;           ///< in treelets, headers filled in; null in a render
  const Index* references = nullptr;       ///< leaves' ranges: local triangle indices
  const Index* corners = nullptr;          ///< three local vertex indices for each triangle
  const glm::vec3* vertices = nullptr;     ///< scene units, the input's precision
  const uint32_t* triangle_ids = nullptr;  ///< scene-wide ids
  const uint16_t* materials = nullptr;     ///< a triangle's material
  /// A triangle's part, and in the top bit whether light passes it: read by part() and see_through().
  const uint32_t* parts = nullptr;
  /// opacity_mask.h, one per triangle; null: all triangles are opaque. Where light passes the material
  /// itself, decoding has made opaque states mixed: no mask describes such a surface.
  const uint32_t* masks = nullptr;
  const FineMask* fine_masks = nullptr;  ///< named by `masks`
  const WideNode* wide = nullptr;        ///< the same tree as wide nodes, derived at decode
  /// A bit for each part of the scene: its triangles are no candidates to any ray. Null: there are none in
  /// this voxel. No block has the bits: a view's selection does.
  const uint64_t* hidden = nullptr;
  uint32_t hidden_words = 0;  ///< 64 parts each; parts beyond them are shown
  uint32_t node_count = 0, wide_count = 0, reference_count = 0, triangle_count = 0, vertex_count = 0,
           fine_mask_count = 0;
  bool has_see_through = false;  ///< whether see_through() holds for any triangle

  /// The bit of `parts` that marks a see-through triangle; parts are below it.
  static constexpr uint32_t kSeeThrough = 1u << 31;

  QUARRY_HOST_DEVICE uint32_t part(uint32_t triangle) const { return parts[triangle] & ~kSeeThrough; }
  /// Whether rays may pass the triangle, see EffectOf(). Decoding derives it from the material
  /// (LetsLightThrough) and the mask.
  QUARRY_HOST_DEVICE bool see_through(uint32_t triangle) const {
    return (parts[triangle] & kSeeThrough) != 0;
  }
  /// Requires: `hidden` is not null.
  QUARRY_HOST_DEVICE bool is_hidden(uint32_t triangle) const {
    const uint32_t of = part(triangle);
    return of / 64 < hidden_words && (hidden[of / 64] >> of % 64 & 1) != 0;
  }
  const glm::vec3& vertex(uint32_t triangle, int corner) const {
    return vertices[corners[3 * triangle + static_cast<uint32_t>(corner)]];
  }
};

using VoxelGeometry = VoxelGeometryOf<uint16_t>;

/// The effect of a hit on a ray.
enum class HitEffect {
  kCounts,   ///< it is a hit
  kNoted,    ///< the ray, an any-hit ray, passes it and notes that it has met a see-through triangle
  kNothing,  ///< it lies in a hole, or its part is hidden
};

/// The effect of a hit of a triangle at the weights `b1` and `b2`. Shading looks at the hits that masks leave
/// open: it may reject a hit of a closest-hit ray (Ray::GoOnAfterHit), and looks at what any-hit rays note.
template <bool kAnyHit, class Index>
QUARRY_HOST_DEVICE inline HitEffect EffectOf(const VoxelGeometryOf<Index>& voxel, uint32_t triangle, float b1,
                                             float b2) {
  if (voxel.hidden != nullptr && voxel.is_hidden(triangle)) return HitEffect::kNothing;
  if (!voxel.has_see_through || !voxel.see_through(triangle)) return HitEffect::kCounts;
  const OpacityState state =
      voxel.masks ? StateAt(voxel.masks[triangle], voxel.fine_masks, b1, b2) : OpacityState::kMixed;
  if (state == OpacityState::kTransparent) return HitEffect::kNothing;
  return kAnyHit && state == OpacityState::kMixed ? HitEffect::kNoted : HitEffect::kCounts;
}
/// Whether EffectOf() may be another than kCounts.
template <bool kAnyHit, class Index>
QUARRY_HOST_DEVICE inline bool MayPass(const VoxelGeometryOf<Index>& voxel, uint32_t triangle) {
  return voxel.hidden != nullptr ||
         ((kAnyHit ? voxel.has_see_through : voxel.masks != nullptr) && voxel.see_through(triangle));
}

template <class Index>
QUARRY_HOST_DEVICE inline TrianglePoints PointsOf(const VoxelGeometryOf<Index>& voxel, uint32_t local) {
  const Index* corner = voxel.corners + size_t{3} * local;
  return {{&voxel.vertices[corner[0]].x, &voxel.vertices[corner[1]].x, &voxel.vertices[corner[2]].x}};
}

/// The box of a voxel's triangles, scene units, grown by the scene's padding: it holds any hit that traversal
/// may see.
struct VoxelBounds {
  float lower[3], upper[3];
};

/// The top-level tree, which every worker holds whole. A leaf is a voxel, a voxel chain, or empty. Read-only
/// and thread-safe.
struct TopTree {
  const KdNode* nodes = nullptr;  ///< in treelets, headers filled in
  const uint32_t* chain_end =
      nullptr;  ///< per voxel: one past the last of its leaf, whose ids follow each other
  const VoxelBounds* bounds = nullptr;  ///< per voxel: rays that miss the box do not visit the voxel
  glm::vec3 lower{0}, upper{0};         ///< the root's box: the scene's bounds, padded
  /// The same tree as wide nodes, with boxes cut down to their content; derived at decode.
  const WideNode* wide = nullptr;

  /// The next voxel of the same leaf, or kNoVoxel.
  QUARRY_HOST_DEVICE uint32_t NextInChain(uint32_t voxel) const {
    return voxel + 1 < chain_end[voxel] ? voxel + 1 : kNoVoxel;
  }
  /// The voxel with which a ray continues in the leaf whose first voxel is `first`: `voxel`, for which it has
  /// waited, if the leaf has it; else `first`.
  QUARRY_HOST_DEVICE uint32_t GoOnInChain(uint32_t first, uint32_t voxel) const {
    return first < voxel && voxel < chain_end[first] ? voxel : first;
  }
};

/// Finds a voxel for a kernel: its geometry, or null when it is not resident. The geometry stays valid until
/// the kernel returns. Called on the kernel's thread; must not block.
template <class IndexType>
struct VoxelFinderOf {
  using Index = IndexType;
  const VoxelGeometryOf<Index>* (*find)(void* context, uint32_t voxel);
  void* context;

  QUARRY_HOST_DEVICE const VoxelGeometryOf<Index>* Find(uint32_t voxel) const { return find(context, voxel); }
};
using VoxelFinder = VoxelFinderOf<uint16_t>;

}  // namespace quarry

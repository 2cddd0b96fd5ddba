#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>

#include "common/kdtree/ray_frame.h"
#include "common/kdtree/trace/triangle_test.h"
#include "common/kdtree/voxel_geometry.h"

// Triangles of a leaf side by side, gathered once for all rays that are tested against them.

namespace quarry {

/// One ray in all lanes, its axes renamed.
template <class W>
struct BlockRay {
  RayFrame<W> frame;
  uint32_t axes[3];  ///< the coordinates that are x, y and z in its frame
};

/// Up to kMost gathered triangles. `W`: lanes that are triangles.
template <class W>
class TriangleBlock {
 public:
  static constexpr uint32_t kMost = 32;

  /// The triangles that `references` name. Requires: 1 <= count <= kMost.
  template <class Index>
  QUARRY_HOST_DEVICE TriangleBlock(const VoxelGeometryOf<Index>& voxel, const Index* references,
                                   uint32_t count)
      : count_(count), vectors_((count + W::kLanes - 1) / W::kLanes) {
    for (uint32_t v = 0; v < vectors_; ++v) {
      const Index* local = references + v * W::kLanes;
      const uint32_t lanes = LanesOf(v);
      const auto points = [&](uint32_t i) { return PointsOf(voxel, local[i < lanes ? i : 0]); };
      typename W::Float at[3][3];
      W::GatherCorners(points, 2, at[0], at[1], at[2]);
      for (uint32_t a = 0; a < 3; ++a)
        for (uint32_t k = 0; k < 3; ++k) W::Store(at[a][k], at_[v][a][k]);
    }
  }

  /// The triangles that the ray may hit, as bits. No branch depends on the ray.
  template <class Statistics>
  QUARRY_HOST_DEVICE uint32_t MayHit(const BlockRay<W>& ray, Statistics& statistics) const {
    uint32_t bits = 0;
    for (uint32_t v = 0; v < vectors_; ++v) {
      statistics.Triangle(LanesOf(v), W::kLanes);
      MovedVertex<W> moved[3];
      Move(v, ray, moved);
      bits |= W::Bits(MayContain<W>(moved[0], moved[1], moved[2], W::FromBits(W::kAllLanes)))
              << (v * W::kLanes);
    }
    return bits & (count_ == kMost ? ~0u : (1u << count_) - 1);
  }

  /// Calls `keep(i, t, b1, b2)` for each triangle of `candidates` (bits from MayHit) that the ray hits at t
  /// up to `best_t`. `keep` may change `best_t`.
  template <class Keep, class Statistics>
  QUARRY_HOST_DEVICE void ForEachHit(const BlockRay<W>& ray, uint32_t candidates, const float& best_t,
                                     Statistics& statistics, const Keep& keep) const {
    for (uint32_t v = 0; v < vectors_; ++v) {
      const uint32_t lanes = candidates >> (v * W::kLanes) & W::kAllLanes;
      if (lanes == 0) continue;
      statistics.Exact();
      MovedVertex<W> moved[3];
      Move(v, ray, moved);
      const TriangleHit<W> found = HitMoved<W>(ray.frame, moved[0], moved[1], moved[2], W::FromBits(lanes));
      ForEachLaneHit<W>(found, W::Set(best_t), [&](uint32_t lane, float t, float b1, float b2) {
        keep(v * W::kLanes + lane, t, b1, b2);
      });
    }
  }

 private:
  QUARRY_HOST_DEVICE uint32_t LanesOf(uint32_t v) const {
    return std::min(W::kLanes, count_ - v * W::kLanes);
  }
  QUARRY_HOST_DEVICE void Move(uint32_t v, const BlockRay<W>& ray, MovedVertex<W> (&moved)[3]) const {
#pragma GCC unroll 3
    for (int k = 0; k < 3; ++k) {
      const auto offset = [&](int a) { return W::Load(at_[v][ray.axes[a]][k]) - ray.frame.origin[a]; };
      moved[k] = MoveVertex<W>(ray.frame, offset(0), offset(1), offset(2));
    }
  }

  uint32_t count_, vectors_;
  alignas(64) float at_[kMost / W::kLanes][3][3][W::kLanes];  ///< by vector, axis, corner, lane
};

}  // namespace quarry

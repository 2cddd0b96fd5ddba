#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/kdtree/build/treelets.h"
#include "common/kdtree/kernels.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_reader.h"

namespace quarry::test {

/// The layout of a scene's trees: in treelets as stores have them, for kd-backtrack, for kd-restart, or with
/// ropes (treelets.h, ropes.h).
enum class TreeLayout { kTreelets, kBacktrack, kRestart, kRopes };
inline constexpr uint32_t kBacktrackLevels = 1;   ///< of treelets: kd-backtrack
inline constexpr uint32_t kRestartLevels = 1000;  ///< more than any tree has: kd-restart

/// The trees of a scene in a layout.
class SceneView {
 public:
  const TopTree& top() const { return top_; }
  /// A finder to which every voxel is resident.
  VoxelFinder finder() const {
    return {
        [](void* context, uint32_t voxel) { return &static_cast<const SceneView*>(context)->voxels_[voxel]; },
        const_cast<SceneView*>(this)};
  }
  const std::vector<VoxelGeometry>& voxels() const { return voxels_; }
  /// Node slots of a voxel's tree and of the top-level tree, with headers of treelets and records of ropes.
  uint32_t node_slots(uint32_t voxel) const { return static_cast<uint32_t>(nodes_[voxel].size()); }
  uint32_t top_node_slots() const { return top_node_slots_; }

 private:
  friend class ResidentScene;
  TopTree top_;
  std::vector<VoxelGeometry> voxels_;
  std::vector<std::vector<KdNode>>
      nodes_;  ///< of voxels, in order; last the top level's where it is not the store's
  uint32_t top_node_slots_ = 0;
};

/// Memory between protected pages: an access outside of it ends the program.
class GuardedBytes {
 public:
  explicit GuardedBytes(size_t size);
  GuardedBytes(GuardedBytes&& other) noexcept
      : mapping_(std::exchange(other.mapping_, {})), bytes_(std::exchange(other.bytes_, {})) {}
  ~GuardedBytes();
  std::span<std::byte> bytes() const { return bytes_; }

 private:
  std::span<std::byte> mapping_, bytes_;
};

/// A store with all hot blocks decoded, each between protected pages.
class ResidentScene {
 public:
  static Result<std::unique_ptr<ResidentScene>> Load(const std::string& store);

  const Catalog& catalog() const { return store_->catalog(); }
  const std::vector<VoxelGeometry>& voxels() const { return views_[0]->voxels_; }
  uint64_t decoded_bytes() const { return decoded_bytes_; }
  /// The layout of stores.
  const SceneView& view() const { return *views_[0]; }
  /// Made at the first call. Not thread-safe.
  const SceneView& view(TreeLayout layout);
  /// Gives each triangle the opacity mask `mask_of(id)`, which may name one of `fine`, as if the store had
  /// it. Requires: no other layout has been made.
  void SetMasks(const std::function<uint32_t(uint32_t id)>& mask_of, std::vector<FineMask> fine);
  /// Hides the parts for which `is_hidden` is true, as a view may. Requires: as SetMasks().
  void Hide(const std::function<bool(uint32_t part)>& is_hidden);

 private:
  std::unique_ptr<StoreReader> store_;
  std::vector<GuardedBytes> bytes_;
  std::vector<std::vector<uint32_t>> masks_;  ///< of voxels, as given to SetMasks()
  std::vector<FineMask> fine_masks_;
  std::vector<uint64_t> hidden_;         ///< a bit a part, as given to Hide()
  std::unique_ptr<SceneView> views_[4];  ///< by TreeLayout
  uint64_t decoded_bytes_ = 0;
};

/// Traces all rays of packets. Requires: every voxel is resident.
inline void TraceAll(const SceneView& view, TraceFunction trace, std::vector<RayPacket>& packets) {
  const std::vector<uint64_t> active(packets.size(), ~uint64_t{0});
  trace(view.top(), view.finder(), packets.data(), active.data(), static_cast<uint32_t>(packets.size()));
}

/// Counts of TraceSuspending().
struct Suspensions {
  uint64_t refused = 0;   ///< requests for an absent voxel
  uint64_t repeated = 0;  ///< suspensions of a ray at a voxel for which it had been resumed

  Suspensions& operator+=(const Suspensions& other) {
    refused += other.refused;
    repeated += other.repeated;
    return *this;
  }
};
/// Traces all rays of packets as a worker with a cold cache does. A voxel is absent at its first request. In
/// each round a third of the wanted voxels is resident, so that the rays of a packet get out of step; after
/// the round they are absent again. With several kernels, resumed rays continue in the next kernel. `wanted`:
/// the rays of each packet to trace, as bits; empty: all.
Suspensions TraceSuspending(const SceneView& view, std::span<const TraceFunction> traces,
                            std::vector<RayPacket>& packets, std::span<const uint64_t> wanted = {});
inline Suspensions TraceSuspending(const SceneView& view, TraceFunction trace,
                                   std::vector<RayPacket>& packets) {
  return TraceSuspending(view, std::span(&trace, 1), packets);
}

}  // namespace quarry::test

#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/engine/blocks/sweep.h"
#include "common/engine/rays/lanes.h"
#include "common/kdtree/kernels.h"

namespace quarry {

/// The rays of a tile or a list, in packets of 64. They are traced together, and each waits on its own: a ray
/// that needs an absent block is parked until Resume() names the block. Bit i of a packet's lanes names its
/// ray i. Owned by one thread.
class RayBatch {
 public:
  static constexpr uint32_t kPackets = 64;      ///< limit of packets
  static constexpr uint32_t kTilePackets = 16;  ///< limit of the packets of a tile

  /// Rays that wait for one block.
  struct Parked {
    uint32_t rays = 0;
    OctantMask octants = 0;  ///< octants of their directions
  };

  /// Begins with `packets` packets, none of whose rays is ready, and reuses memory.
  void Open(uint32_t packets) { packets_.resize(packets); }
  uint32_t size() const { return static_cast<uint32_t>(packets_.size()); }
  RayPacket& operator[](uint32_t packet) { return packets_[packet]; }

  /// Notes that `count` rays begin.
  void Began(int count) { counts_.rays += static_cast<uint64_t>(count); }
  struct Counts {
    uint64_t rays = 0;       ///< that have begun
    uint64_t suspended = 0;  ///< times that a ray has waited
  };
  /// The counts since the last call.
  Counts TakeCounts() { return std::exchange(counts_, {}); }

  /// Rays that can go on.
  void MakeReady(uint32_t packet, uint64_t lanes) { ready_[packet] |= lanes; }
  uint64_t TakeReady(uint32_t packet) { return std::exchange(ready_[packet], 0); }
  bool is_ready(uint32_t packet) const { return ready_[packet] != 0; }
  bool has_ready() const {
    return std::ranges::any_of(ready_, [](uint64_t lanes) { return lanes != 0; });
  }

  /// The rays of a packet that the next Trace() traces: to their nearest hits, and to any.
  void SetTraced(uint32_t packet, uint64_t nearest, uint64_t any) {
    nearest_[packet] = nearest;
    any_[packet] = any;
  }
  /// Traces the rays that SetTraced() has named. Parks the rays that wait for a block. Makes the others ready
  /// and calls ended(packet, lanes, whether to any hit) for them.
  template <class Ended>
  void Trace(const TopTree& top, const VoxelFinder& finder, Ended&& ended) {
    TraceAll(top, finder, nearest_, false, ended);
    TraceAll(top, finder, any_, true, ended);
  }

  void Park(uint32_t packet, uint32_t lane, BlockKey block);
  /// Makes the rays parked on `block` ready.
  void Resume(BlockKey block);
  /// Forgets the blocks that a packet's rays wait for.
  void Forget(uint32_t packet);
  /// Forgets the blocks that all rays wait for; no ray is ready.
  void ForgetAll();
  /// Calls want(block, const Parked&) once for each block that rays were parked on since the last call.
  template <class Want>
  void ReportParked(Want&& want) {
    for (const auto& [block, parked] : newly_parked_) want(block, parked);
    newly_parked_.clear();
  }
  size_t memory_bytes() const { return packets_.size() * sizeof(RayPacket); }

 private:
  template <class Ended>
  void TraceAll(const TopTree& top, const VoxelFinder& finder, const uint64_t* active, bool any,
                Ended& ended) {
    TraceRays(top, finder, packets_.data(), active, size(), any);
    for (uint32_t p = 0; p < size(); ++p) {
      if (active[p] == 0) continue;
      const uint64_t waiting = active[p] & ~LanesWith(kNoVoxel, packets_[p].waits_for);
      ForEachLane(waiting, [&](uint32_t i) { Park(p, i, BlockKey::Hot(packets_[p].waits_for[i])); });
      MakeReady(p, active[p] & ~waiting);
      ended(p, active[p] & ~waiting, any);
    }
  }

  std::vector<RayPacket> packets_;
  uint64_t ready_[kPackets] = {};
  uint64_t nearest_[kPackets] = {}, any_[kPackets] = {};
  std::unordered_map<BlockKey, std::vector<uint32_t>> parked_;  ///< packet * 64 + lane
  std::unordered_map<BlockKey, Parked> newly_parked_;
  Counts counts_;
};

}  // namespace quarry

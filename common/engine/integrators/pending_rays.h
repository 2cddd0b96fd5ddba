#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/engine/packet_work.h"

namespace quarry {

/// The rays of a tile's samples that wait for their turn. A sample has one ray under way; its further rays
/// lie here, in a list of bounded length, so that memory is fixed when the tile is opened. The newest goes
/// first. Owned by one thread.
class PendingRays {
 public:
  struct Pending {
    glm::vec3 origin, direction, weight;
    uint32_t path_code;
    uint32_t depth;
  };
  /// The cone of a pending ray, see TextureLookups.
  struct Cone {
    float width, spread;
  };

  /// Makes room for `per_sample` rays of each sample, and for their cones with `cones`.
  void Open(uint32_t packets, uint32_t per_sample, bool cones);
  /// Requires: the sample has fewer than `per_sample` rays here.
  void Push(const PacketWork& work, uint32_t lane, const Pending& ray, const Cone& cone);
  /// Begins the newest rays of `lanes`. Returns: the lanes that had one.
  uint64_t Pop(const PacketWork& work, uint64_t lanes);
  size_t memory_bytes() const { return rays_.size() * sizeof(Pending) + cones_.size() * sizeof(Cone); }

 private:
  size_t PlaceOf(const PacketWork& work, uint32_t lane) const {
    return (work.number * size_t{RayPacket::kRays} + lane) * per_sample_ + work.samples.pending_count[lane];
  }
  uint32_t per_sample_ = 0;
  std::vector<Pending> rays_;
  std::vector<Cone> cones_;  ///< empty where no textures are looked up
};

}  // namespace quarry

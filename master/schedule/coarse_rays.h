#pragma once

#include <cstdint>
#include <list>
#include <memory>
#include <span>
#include <vector>

#include "common/engine/surface.h"
#include "common/kdtree/ray_packet.h"
#include "common/scene/camera.h"
#include "common/scene/render_job.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_reader.h"
#include "master/jobs/frame.h"

namespace quarry {

/// What coarse rays of a tile come to.
struct CoarseTile {
  std::vector<uint32_t> blocks;  ///< ascending
  std::vector<float> depths;     ///< how far from the eye each primary ray goes; infinity: it hits nothing
};
using CoarseFrame = std::vector<CoarseTile>;  ///< by tile; empty: not known

/// A picture rendered with one ray for each 2x2 pixels (of more than half a million: 4x4), to see which
/// voxels its tiles touch: primary rays, and those that the job's mode sends on from what they hit. Voxels
/// come from the store into a cache of fixed size; those that are kept are the last ones used. Source: coarse
/// rays for the next view are proposed by Wald & Slusallek 2001, section 6.5. Not thread-safe.
class CoarseRays {
 public:
  /// Requires: `cache_bytes` is at least the scene's largest decoded block. `store` must outlive this.
  CoarseRays(const StoreReader& store, uint64_t cache_bytes);
  ~CoarseRays();

  /// Errors: the store cannot be read.
  Result<CoarseTile> Trace(const RenderJob& job, const Frame::Tile& tile);

  uint64_t cache_bytes() const { return used_bytes_; }

 private:
  struct Voxel;
  /// A ray, and what it brings to its pixel at most.
  struct Sent {
    Ray ray;
    glm::vec3 weight;
  };

  const VoxelGeometry* Find(uint32_t voxel);
  void Touch(uint32_t block);
  Result<const VoxelGeometry*> Load(uint32_t voxel);
  Status TraceToEnd(RayPacket& packet, uint64_t active, bool any);
  Status SendOn(const RenderJob& job, const RayPacket& packet, std::span<const Sent> sent, bool bounce);
  Status SendToLights(const RenderJob& job, std::span<const Surface> surfaces);
  void Bounced(const Sent& sent, const Surface& surface);

  const StoreReader& store_;
  const Catalog& catalog_;
  const uint64_t most_bytes_;
  uint64_t used_bytes_ = 0;
  BlockDecoder decoder_;
  std::vector<std::unique_ptr<Voxel>> voxels_;  ///< by number; null: not here
  std::list<uint32_t> order_;                   ///< those here, the last one used first
  std::vector<uint32_t> touched_;               ///< blocks, by the tile at hand
  std::vector<bool> is_touched_;
  std::vector<Sent> sent_, next_;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <vector>

#include "common/engine/blocks/pinned_blocks.h"
#include "common/engine/integrators/scatter_packet.h"
#include "common/engine/rays/ray_batch.h"
#include "common/engine/sample_packet.h"
#include "common/engine/surfaces/see_through/cut_packet.h"
#include "common/engine/surfaces/texture_lookups.h"
#include "common/engine/surfaces/texture_packet.h"
#include "common/engine/view_context.h"

namespace quarry {

class PendingRays;
class TileFilm;
struct PathPacket;
struct TintPacket;

/// Resizes memory of a tile, and gives it back if nothing is left.
template <class T>
void Fit(std::vector<T>& values, size_t count) {
  if (count == 0)
    values = {};
  else
    values.resize(count);
}

/// Memory for the data that a stage gathers; packets use it one after the other.
struct Scratch {
  TrianglePacket triangles;
  AttributePacket attributes;
  FootprintPacket footprints;
  TexelPacket texels;
  ScatterPacket scatter;
  LightPacket light;
  Vectors radiance;
};

/// A packet of a tile in the hands of a stage: its rays, its samples, and the other data that the stage may
/// use. A stage works on some lanes of the packet. It moves the lanes that are done to their next stages, and
/// parks the lanes that wait for a block.
/// Not thread-safe.
struct PacketWork {
  const ViewContext& view;
  const uint32_t number;  ///< the packet's in the batch
  RayBatch& batch;
  RayPacket& rays;
  SamplePacket& samples;
  TextureLookups* const lookups;  ///< null: no textures are looked up
  CutPacket* const cut;           ///< null: all hits count
  TintPacket* const tints;        ///< null: no texture tints light
  PathPacket* const path;         ///< null: the integrator needs none
  PendingRays& pending;
  TileFilm& film;
  PinnedBlocks* const pins;  ///< null while a tile is opened
  Scratch& scratch;
  uint64_t scatters = 0;  ///< lanes whose surfaces have not changed since `scratch.scatter` was set for them

  /// Requires: `pins` is not null.
  const ResidentBlock* Find(BlockKey block) const { return pins->Find(block); }
  void Park(uint32_t lane, BlockKey block) const { batch.Park(number, lane, block); }
  /// The lanes whose surfaces have the values of their textures.
  uint64_t looked_up() const { return lookups ? lookups->looked_up : 0; }
};

/// Finds blocks for a packet's lanes. It asks for the block of the last lane only once, since neighbours
/// mostly share it.
template <BlockKey (*kKeyOf)(uint32_t voxel)>
class BlockOfLane {
 public:
  explicit BlockOfLane(const PacketWork& work) : work_(work) {}
  /// The block of the voxel that the lane's ray has hit. Null: it is absent, and the lane is parked.
  const ResidentBlock* operator()(uint32_t lane) {
    if (work_.rays.voxel[lane] != voxel_) {
      voxel_ = work_.rays.voxel[lane];
      block_ = work_.Find(kKeyOf(voxel_));
    }
    if (!block_) work_.Park(lane, kKeyOf(voxel_));
    return block_;
  }
  uint32_t voxel() const { return voxel_; }

 private:
  const PacketWork& work_;
  uint32_t voxel_ = kNoVoxel;
  const ResidentBlock* block_ = nullptr;
};
using HotBlockOfLane = BlockOfLane<BlockKey::Hot>;
using ShadingBlockOfLane = BlockOfLane<BlockKey::Shading>;

}  // namespace quarry

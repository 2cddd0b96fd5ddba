#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include "common/engine/blocks/pinned_blocks.h"
#include "common/engine/blocks/sweep.h"
#include "common/engine/eye_rays.h"
#include "common/engine/sample_packet.h"
#include "common/engine/shading/shading_packet.h"
#include "common/engine/texture/cut_packet.h"
#include "common/engine/texture/look_packet.h"
#include "common/engine/texture/texture_packet.h"
#include "common/engine/tile_film.h"
#include "common/kdtree/ray_packet.h"
#include "common/math/random.h"

namespace quarry {

/// Renders one tile at a time and never blocks: rays that need an absent block are parked until Resume()
/// names it. Samples go in packets of 64, an 8x8 square of pixels. The rays of a packet are traced and shaded
/// together, but each waits on its own. A sample has one ray under way; its further rays lie in a list of
/// bounded length, so that memory is fixed when the tile is opened. Pixels do not depend on the order of
/// samples: see FixedRadiance. Owned by one thread.
/// Source: Purcell et al. 2002, section 3: generate, traverse, shade, then new rays that carry their weight;
/// no recursion.
class TileRenderer {
 public:
  static constexpr uint32_t kPackets = 16;  ///< limit of packets in flight

  /// Begins a tile and reuses the memory of the last. Requires: done().
  void Open(std::shared_ptr<const ViewContext> view, const Tile& tile);

  /// Rays that wait for one block.
  struct Parked {
    uint32_t rays = 0;
    OctantMask octants = 0;  ///< octants of their directions
  };

  /// Advances every ready sample to its next ray and traces these rays. Calls `want(block, const Parked&)`
  /// once for each block that rays were parked on in this call.
  template <class Want>
  void Step(PinnedBlocks& pins, Want&& want) {
    if (reader_ == 0) reader_ = pins.NewReader();
    pins.LogTo(touched_, reader_);
    Round(pins);
    if (touched_.size() > kMostTouched) TidyTouched();
    for (const auto& [block, parked] : newly_parked_) want(block, parked);
    newly_parked_.clear();
  }
  /// Ends the tile unfinished. Blocks that its rays waited for may still be delivered.
  void Abandon();
  /// Ends the tile with holes where rays wait. Requires: the tile leaves holes; no ray is ready.
  void LeaveHoles();
  /// Makes the rays parked on `block` ready. Requires: the block is pinned during the next Step().
  void Resume(BlockKey block);

  /// Whether Step() has something to do.
  bool has_ready() const {
    return std::ranges::any_of(ready_, [](uint64_t samples) { return samples != 0; });
  }
  /// Whether all samples have ended.
  bool done() const {
    return std::ranges::all_of(unfinished_, [](uint64_t samples) { return samples == 0; });
  }
  /// Whether only LeaveHoles() is left to do.
  bool may_leave_holes() const { return tile_.leaves_holes && !has_ready() && !done(); }
  const ViewContext& view() const { return *view_; }
  /// Bytes of the tile's samples and pixels.
  size_t memory_bytes() const;
  /// Takes the result; `compute_us` is left to the caller. Requires: done().
  RenderedTile Take();

 private:
  struct Pending {
    glm::vec3 origin, direction, weight;
    uint32_t path_code;
    uint32_t depth;
  };
  /// The cone of a pending ray, see LookPacket.
  struct PendingCone {
    float width, spread;
  };
  /// Limit of a sample's pending rays. The newest goes first, so at most one waits at each depth and two at
  /// the last.
  static constexpr size_t kMostPending = kMostBounces + 1;
  /// Length of touched_ at which repetitions are removed; 128 KiB.
  static constexpr size_t kMostTouched = 1u << 14;
  /// Scratch memory for data gathered from voxels; packets use it one after the other.
  struct Gathered {
    TrianglePacket triangles;
    AttributePacket attributes;
    LightPacket light;
    Vectors radiance;
    PrimaryRays eye;
    FootprintPacket footprints;
    TexelPacket texels;
  };

  void StartPacket(uint32_t packet);
  void StartCones(uint32_t packet);
  void LeaveHoles(uint32_t packet);
  void Round(PinnedBlocks& pins);
  void Trace(PinnedBlocks& pins, const uint64_t* active, bool any);
  void Traced(uint32_t packet, uint64_t lanes, bool any);
  void Shadowed(uint32_t packet, uint64_t lanes);
  void Advance(uint32_t packet, PinnedBlocks& pins);
  /// What is known of a hit on a triangle with cut-outs; kOpen: the next step tells.
  enum class Cut { kThere, kInHole, kWaits, kOpen };
  struct CutResult {
    uint64_t there = 0, holes = 0, waiting = 0;  ///< lanes
  };
  /// The hot block of the last lane; neighbours mostly share it.
  struct HotBlock {
    uint32_t voxel = kNoVoxel;
    const ResidentBlock* block = nullptr;
  };
  CutResult TestCuts(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  Cut TestCut(uint32_t packet, uint32_t lane, HotBlock& hot, PinnedBlocks& pins);
  Cut TestMask(uint32_t packet, uint32_t lane, HotBlock& hot, PinnedBlocks& pins);
  Cut PlaceCut(uint32_t packet, uint32_t lane, PinnedBlocks& pins);
  Cut TestOpacity(uint32_t packet, uint32_t lane, PinnedBlocks& pins);
  float CutShare(uint32_t packet, uint32_t lane) const;
  uint64_t TestHits(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  void StartTests(uint32_t packet, uint64_t lanes);
  void TakeHits(uint32_t packet, uint64_t lanes, SamplePacket::Stage from);
  float EndOfShadowRay(uint32_t packet, uint32_t lane) const;
  uint64_t FindSurfaces(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  uint64_t FindAttributes(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  uint64_t FrameTextures(uint32_t packet, uint64_t lanes);
  uint64_t FindTextures(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  uint64_t LookUp(uint32_t packet, uint64_t lanes, const SurfaceTexture& texture, PinnedBlocks& pins);
  uint64_t GatherTexels(uint32_t packet, uint64_t lanes, const TexturePyramid& pyramid, PinnedBlocks& pins);
  uint64_t LookUpSingly(uint32_t packet, uint64_t lanes, const TexturePyramid& pyramid, LookupKind kind,
                        PinnedBlocks& pins);
  uint64_t LookedAt(uint32_t packet) const { return looks_.empty() ? 0 : looks_[packet].looked; }
  SurfaceProperties PropertiesOf(uint32_t packet, uint32_t lane) const;
  void Illuminate(uint32_t packet, uint64_t lanes);
  void IlluminateLooked(uint32_t packet, uint64_t lanes);
  void ScatterLight(uint32_t packet, uint64_t lanes, const Light& light);
  void SpawnFrom(const SurfaceProperties& material, uint32_t packet, uint32_t lane);
  void Shade(uint32_t packet, uint64_t lanes);
  void Occlude(uint32_t packet, uint64_t lanes);
  void NextLights(uint32_t packet, uint64_t lanes);
  uint64_t Tint(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  bool TintBy(uint32_t packet, uint32_t lane, const VoxelGeometry& voxel);
  void Spawn(uint32_t packet, uint64_t lanes);
  void TakeNext(uint32_t packet, uint64_t lanes);
  void TidyTouched();
  void Miss(uint32_t packet, uint32_t lane);
  void Park(uint32_t packet, uint32_t lane, BlockKey block);
  void ShadeVoxels(uint32_t packet, uint64_t lanes);
  Ray RayOf(uint32_t packet, uint32_t lane) const;
  void WriteAovs(uint32_t packet, uint32_t lane);
  void Add(uint32_t packet, uint64_t lanes, const Vectors& radiance);
  /// The first of a sample's places among the pending rays.
  static size_t PendingPlace(uint32_t packet, uint32_t lane) {
    return (packet * size_t{RayPacket::kRays} + lane) * kMostPending;
  }

  std::shared_ptr<const ViewContext> view_;
  Tile tile_;
  EyeRayGenerator eye_rays_;
  std::vector<RayPacket> packets_;
  std::vector<SamplePacket> samples_;
  std::vector<Pending> pending_;            ///< empty where rays do not bounce
  std::vector<LookPacket> looks_;           ///< empty where the view has no textures
  std::vector<CutPacket> cuts_;             ///< empty where the scene has no cut-outs
  std::vector<PendingCone> pending_cones_;  ///< empty where pending_ or looks_ is
  std::unique_ptr<Gathered> gathered_ = std::make_unique<Gathered>();
  uint64_t ready_[kPackets] = {};               ///< samples that can go on, a bit each
  uint64_t closest_[kPackets], any_[kPackets];  ///< rays to trace in this round
  uint64_t unfinished_[kPackets] = {};          ///< samples under way, a bit each
  std::unordered_map<BlockKey, std::vector<uint32_t>> parked_;
  std::unordered_map<BlockKey, Parked> newly_parked_;
  uint64_t rays_ = 0, rays_suspended_ = 0;
  uint32_t reader_ = 0;            ///< see PinnedBlocks::LogTo(); 0: none yet
  std::vector<BlockKey> touched_;  ///< with repetitions
  TileFilm film_;
};

}  // namespace quarry

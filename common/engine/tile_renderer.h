#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/engine/pinned_blocks.h"
#include "common/engine/shading_packet.h"
#include "common/engine/sweep.h"
#include "common/kdtree/ray_packet.h"
#include "common/math/fixed_radiance.h"
#include "common/math/random.h"
#include "common/protocol/messages.h"
#include "common/scene/camera.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// What tiles of one frame share. Immutable.
struct FrameContext {
  FrameContext(uint64_t setup_number, const RenderJob& render_job, const Catalog& scene)
      : setup(setup_number),
        job(render_job),
        catalog(scene),
        top(scene.top_tree()),
        camera(render_job.cameras[0], render_job.width, render_job.height, scene.meta.root_lower,
               scene.meta.root_upper),
        words(WordsPerPixel(render_job.aov_mask)) {}
  uint64_t setup;
  RenderJob job;
  const Catalog& catalog;
  TopTree top;
  Camera camera;
  uint32_t words;
};

/// The samples of a packet, field by field; the ray that each has under way is in a RayPacket at the same
/// lane.
struct SamplePacket {
  /// What a sample is about to do; each step is taken for all samples of a packet together.
  enum Stage { kTraverse, kSurface, kAttributes, kShade, kLight, kShadow, kBounce, kNext, kStages };
  static constexpr int kLanes = RayPacket::kRays;

  uint64_t at[kStages];  ///< lanes, by stage
  SurfacePacket surface;
  Vectors weight;
  Vectors light;  ///< what the shadow ray brings if nothing is in its way
  float t_offset[kLanes];
  uint32_t sample[kLanes];
  uint32_t path_code[kLanes];
  uint32_t next_light[kLanes];
  uint16_t pixel[kLanes];
  uint16_t depth_cell[kLanes];
  uint8_t depth[kLanes];
  uint8_t pending_count[kLanes];

  void Move(uint64_t lanes, Stage from, Stage to) {
    at[from] &= ~lanes;
    at[to] |= lanes;
  }
};

/// Renders one tile at a time, never blocking: rays that need an absent block are parked until Resume names
/// it. Ray states after Purcell et al. 2002, section 3: generate, traverse, shade, and from there new rays,
/// each with its weight; no recursion. Samples go in packets of 64, an 8x8 block of pixels: a packet's rays
/// are traced and shaded together, but wait each for itself. Every sample has one ray under way; what it has
/// still to trace lies in a stack of bounded size in its own slot, so that memory is fixed when a tile is
/// opened. Pixels do not depend on the order of anything: see FixedRadiance. Owned by one thread.
class TileRenderer {
 public:
  static constexpr uint32_t kPackets = 16;  ///< in flight, at most

  /// Begins a tile; memory of the one before is used again. Requires: done().
  void Open(std::shared_ptr<const FrameContext> frame, const TileOrder& order);

  /// Rays that wait for one block.
  struct Parked {
    uint32_t rays = 0;
    OctantMask octants = 0;  ///< that they point to
  };

  /// Takes every ready sample to its next ray, and traces those rays. `want(block, const Parked&)` is called
  /// once a block that rays have been parked on in this call.
  template <class Want>
  void Step(PinnedBlocks& pins, Want&& want) {
    if (reader_ == 0) reader_ = pins.NewReader();
    pins.LogTo(touched_, reader_);
    Round(pins);
    if (touched_.size() > kMostTouched) TidyTouched();
    for (const auto& [block, parked] : newly_parked_) want(block, parked);
    newly_parked_.clear();
  }
  /// Rays parked on `block` are ready again. Requires: the block is pinned during the next Step.
  void Resume(uint32_t block);

  bool has_ready() const {
    return std::ranges::any_of(ready_, [](uint64_t samples) { return samples != 0; });
  }
  bool done() const {
    return std::ranges::all_of(unfinished_, [](uint64_t samples) { return samples == 0; });
  }
  const TileOrder& order() const { return order_; }
  const FrameContext& frame() const { return *frame_; }
  /// What the tile's samples and pixels take.
  size_t memory_bytes() const;
  uint64_t rays() const { return rays_; }
  uint64_t rays_suspended() const { return rays_suspended_; }

  /// Blocks that its rays have been in, ascending.
  std::vector<uint32_t> TakeTouched() {
    TidyTouched();
    return std::exchange(touched_, {});
  }
  /// By depth cell, row by row: how far the farthest primary ray goes, infinity where one hits nothing.
  const std::vector<float>& depths() const { return depths_; }

  /// The tile's pixels, row by row, words_per_pixel 32-bit words each. Requires: done().
  Bytes Pixels() const;

 private:
  /// A pixel of the tile, in the order that samples are taken in.
  struct Place {
    uint16_t pixel;
    uint8_t x, y;  ///< in the tile
  };
  static_assert(kTileSize <= 256);
  struct Pending {
    glm::vec3 origin, direction, weight;
    uint32_t path_code;
    uint32_t depth;
  };
  static constexpr size_t kMostPending =
      kMostBounces + 1;  ///< the newest goes first, so at most one waits per depth, and two at the last
  static constexpr size_t kMostTouched = 1u << 14;  ///< then repetitions go
  /// Rooms for what is gathered from voxels, used by one packet after the other.
  struct Gathered {
    TrianglePacket triangles;
    AttributePacket attributes;
    LightPacket light;
    Vectors radiance;
    PrimaryRays primary;
  };

  void OrderPixels();
  void StartPacket(uint32_t packet);
  uint64_t StartSamples(uint32_t packet);
  void Round(PinnedBlocks& pins);
  void Trace(PinnedBlocks& pins, const uint64_t* active, bool any);
  void Traced(uint32_t packet, uint64_t lanes, bool any);
  void Advance(uint32_t packet, PinnedBlocks& pins);
  uint64_t FindSurfaces(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  uint64_t FindAttributes(uint32_t packet, uint64_t lanes, PinnedBlocks& pins);
  void Shade(uint32_t packet, uint64_t lanes);
  void NextLights(uint32_t packet, uint64_t lanes);
  void Spawn(uint32_t packet, uint64_t lanes);
  void TakeNext(uint32_t packet, uint64_t lanes);
  void TidyTouched();
  void Miss(uint32_t packet, uint32_t lane);
  void SawTo(uint32_t depth_cell, float depth);
  void Park(uint32_t packet, uint32_t lane, uint32_t block);
  void ShadeVoxels(uint32_t packet, uint64_t lanes);
  Ray RayOf(uint32_t packet, uint32_t lane) const;
  void WriteAovs(uint32_t packet, uint32_t lane);
  void Add(uint32_t packet, uint64_t lanes, const Vectors& radiance);
  void Add(uint32_t pixel, const glm::vec3& radiance);
  Pending* PendingOf(uint32_t packet, uint32_t lane) {
    return pending_.data() + (packet * size_t{RayPacket::kRays} + lane) * kMostPending;
  }

  std::shared_ptr<const FrameContext> frame_;
  TileOrder order_;
  std::vector<Place> places_;  ///< 8x8 block by block
  std::vector<RayPacket> packets_;
  std::vector<SamplePacket> samples_;
  std::vector<Pending> pending_;  ///< only where rays bounce
  std::unique_ptr<Gathered> gathered_ = std::make_unique<Gathered>();
  uint64_t ready_[kPackets] = {};               ///< samples that can go on, as bits
  uint64_t closest_[kPackets], any_[kPackets];  ///< rays to trace in this round
  uint64_t unfinished_[kPackets] = {};          ///< samples of the packet still under way
  std::unordered_map<uint32_t, std::vector<uint32_t>> parked_;
  std::unordered_map<uint32_t, Parked> newly_parked_;
  uint64_t next_sample_ = 0;  ///< over the tile's pixels, sample by sample
  uint64_t rays_ = 0, rays_suspended_ = 0;
  uint32_t reader_ = 0;            ///< see PinnedBlocks::LogTo; 0: none yet
  std::vector<uint32_t> touched_;  ///< blocks, with repetitions
  std::vector<float> depths_;
  std::vector<FixedRadiance> radiance_;  ///< 3 a pixel
  std::vector<uint32_t> aovs_;           ///< words - 3 a pixel
};

}  // namespace quarry

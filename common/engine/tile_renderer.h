#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <unordered_map>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/engine/blocks/pinned_blocks.h"
#include "common/engine/blocks/sweep.h"
#include "common/engine/shading/shading_packet.h"
#include "common/kdtree/ray_packet.h"
#include "common/math/fixed_radiance.h"
#include "common/math/random.h"
#include "common/scene/camera.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A view of a scene, prepared once for all of its tiles. Immutable but for `abandoned`.
/// Requires: a view of a normalized job.
struct ViewContext {
  ViewContext(View a_view, const Catalog& scene)
      : view(std::move(a_view)),
        catalog(scene),
        top(scene.top_tree()),
        camera(view.camera, view.width, view.height, scene.meta.root_lower, scene.meta.root_upper),
        words(WordsPerPixel(view.aov_mask)) {}
  const View view;
  const Catalog& catalog;
  const TopTree top;
  const Camera camera;
  const uint32_t words;                ///< 32-bit words a pixel
  std::atomic<bool> abandoned{false};  ///< nobody waits for its tiles any more
};

/// A part of a view to be rendered at once.
/// Units: pixels of the view. Requires: it lies in the view, no side longer than 256 lattice points.
struct Tile {
  PixelRect pixels;
  /// Of each square of so many pixels a side one is rendered, at its middle; 1: all.
  uint32_t step = 1;
  /// Hits of sample 0 instead of colours: nothing is shaded, no ray is sent on.
  bool hits_only = false;

  uint32_t columns() const { return (pixels.width + step - 1) / step; }
  uint32_t rows() const { return (pixels.height + step - 1) / step; }
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  Bytes pixels;                  ///< ViewContext::words 32-bit words a point; empty with hits_only
  std::vector<Hit> hits;         ///< one a point; empty without hits_only
  std::vector<float> depths;     ///< a depth cell of points each: where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< that its rays have been in, ascending
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t compute_us = 0;  ///< wall time of its thread, waiting for blocks not counted
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
  void Open(std::shared_ptr<const ViewContext> view, const Tile& tile);

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
  /// Ends the tile where it stands; blocks that its rays wait for may still be delivered.
  void Abandon();
  /// Rays parked on `block` are ready again. Requires: the block is pinned during the next Step.
  void Resume(BlockKey block);

  bool has_ready() const {
    return std::ranges::any_of(ready_, [](uint64_t samples) { return samples != 0; });
  }
  bool done() const {
    return std::ranges::all_of(unfinished_, [](uint64_t samples) { return samples == 0; });
  }
  const ViewContext& view() const { return *view_; }
  /// Bytes that the tile's samples and pixels take.
  size_t memory_bytes() const;
  /// The result, all but the time. Requires: done().
  RenderedTile Take();

 private:
  /// A pixel of the tile, in the order that samples are taken in.
  struct Place {
    uint16_t pixel;
    uint8_t x, y;  ///< lattice point in the tile
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

  uint64_t SampleCount() const {
    return places_.size() * (tile_.hits_only ? uint64_t{1} : uint64_t{view_->view.spp});
  }
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
  void TakeHit(uint32_t packet, uint32_t lane);
  void Miss(uint32_t packet, uint32_t lane);
  void SawTo(uint32_t depth_cell, float depth);
  void Park(uint32_t packet, uint32_t lane, BlockKey block);
  Bytes Pixels() const;
  void ShadeVoxels(uint32_t packet, uint64_t lanes);
  Ray RayOf(uint32_t packet, uint32_t lane) const;
  void WriteAovs(uint32_t packet, uint32_t lane);
  void Add(uint32_t packet, uint64_t lanes, const Vectors& radiance);
  void Add(uint32_t pixel, const glm::vec3& radiance);
  Pending* PendingOf(uint32_t packet, uint32_t lane) {
    return pending_.data() + (packet * size_t{RayPacket::kRays} + lane) * kMostPending;
  }

  std::shared_ptr<const ViewContext> view_;
  Tile tile_;
  std::vector<Place> places_;  ///< 8x8 block by block
  std::vector<RayPacket> packets_;
  std::vector<SamplePacket> samples_;
  std::vector<Pending> pending_;  ///< only where rays bounce
  std::unique_ptr<Gathered> gathered_ = std::make_unique<Gathered>();
  uint64_t ready_[kPackets] = {};               ///< samples that can go on, as bits
  uint64_t closest_[kPackets], any_[kPackets];  ///< rays to trace in this round
  uint64_t unfinished_[kPackets] = {};          ///< samples of the packet still under way
  std::unordered_map<BlockKey, std::vector<uint32_t>> parked_;
  std::unordered_map<BlockKey, Parked> newly_parked_;
  uint64_t next_sample_ = 0;  ///< over the tile's pixels, sample by sample
  uint64_t rays_ = 0, rays_suspended_ = 0;
  uint32_t reader_ = 0;            ///< see PinnedBlocks::LogTo; 0: none yet
  std::vector<BlockKey> touched_;  ///< with repetitions
  std::vector<float> depths_;
  std::vector<FixedRadiance> radiance_;  ///< 3 a pixel
  std::vector<uint32_t> aovs_;           ///< words - 3 a pixel
  std::vector<Hit> hits_;                ///< one a pixel; empty without hits_only
};

}  // namespace quarry

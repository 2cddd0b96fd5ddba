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

/// A view of a scene, prepared once for all of its tiles. Immutable except `abandoned`.
/// Requires: the view is of a normalized job.
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
  const uint32_t words;                ///< 32-bit words per pixel
  std::atomic<bool> abandoned{false};  ///< its tiles are wanted no more
};

/// A part of a view that is rendered as a whole. A step above 1 selects a lattice of its pixels.
/// Units: pixels of the view. Requires: it lies in the view; no side exceeds 256 lattice points.
struct Tile {
  PixelRect pixels;
  /// Side of the squares that have one lattice point each, at their middle. 1: every pixel is a lattice
  /// point.
  uint32_t step = 1;
  /// Whether the result is the hits of sample 0 instead of colours; nothing is shaded then.
  bool hits_only = false;

  uint32_t columns() const { return (pixels.width + step - 1) / step; }
  uint32_t rows() const { return (pixels.height + step - 1) / step; }
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  Bytes pixels;                  ///< ViewContext::words 32-bit words per point; empty with hits_only
  std::vector<Hit> hits;         ///< one per point; empty without hits_only
  std::vector<float> depths;     ///< per depth cell: t where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< blocks that its rays touched, ascending
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t compute_us = 0;  ///< wall time of its thread without waits for blocks
};

/// The samples of a packet, one array per field. The ray of a sample is in the RayPacket at the same lane.
struct SamplePacket {
  /// The next step of a sample. A step is done for all samples of a packet together.
  enum Stage { kTraverse, kSurface, kAttributes, kShade, kLight, kShadow, kBounce, kNext, kStages };
  static constexpr int kLanes = RayPacket::kRays;

  uint64_t at[kStages];  ///< lanes in each stage
  SurfacePacket surface;
  Vectors weight;
  Vectors light;  ///< radiance that the shadow ray adds if nothing blocks it
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
  const ViewContext& view() const { return *view_; }
  /// Bytes of the tile's samples and pixels.
  size_t memory_bytes() const;
  /// Takes the result; `compute_us` is left to the caller. Requires: done().
  RenderedTile Take();

 private:
  /// A lattice point of the tile, in the order of sampling.
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
  std::vector<Place> places_;  ///< in 8x8 squares
  std::vector<RayPacket> packets_;
  std::vector<SamplePacket> samples_;
  std::vector<Pending> pending_;  ///< empty where rays do not bounce
  std::unique_ptr<Gathered> gathered_ = std::make_unique<Gathered>();
  uint64_t ready_[kPackets] = {};               ///< samples that can go on, a bit each
  uint64_t closest_[kPackets], any_[kPackets];  ///< rays to trace in this round
  uint64_t unfinished_[kPackets] = {};          ///< samples under way, a bit each
  std::unordered_map<BlockKey, std::vector<uint32_t>> parked_;
  std::unordered_map<BlockKey, Parked> newly_parked_;
  uint64_t next_sample_ = 0;  ///< counts all pixels of sample 0, then of sample 1
  uint64_t rays_ = 0, rays_suspended_ = 0;
  uint32_t reader_ = 0;            ///< see PinnedBlocks::LogTo(); 0: none yet
  std::vector<BlockKey> touched_;  ///< with repetitions
  std::vector<float> depths_;
  std::vector<FixedRadiance> radiance_;  ///< 3 per pixel
  std::vector<uint32_t> aovs_;           ///< words - 3 per pixel
  std::vector<Hit> hits_;                ///< one per pixel; empty without hits_only
};

}  // namespace quarry

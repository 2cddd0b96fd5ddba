#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <vector>

#include "common/engine/blocks/touched_blocks.h"
#include "common/engine/film/tile_film.h"
#include "common/engine/integrators/path/path_packet.h"
#include "common/engine/integrators/pending_rays.h"
#include "common/engine/packet_work.h"
#include "common/engine/rays/ray_batch.h"
#include "common/engine/sources/edge_rays.h"
#include "common/engine/sources/eye_rays.h"
#include "common/engine/sources/ray_list.h"
#include "common/engine/surfaces/see_through/tint_packet.h"

namespace quarry {

/// Renders one tile, or traces one part of a list of rays, at a time and never blocks. Samples go in packets
/// of 64. A source gives them their first rays, the batch traces these, surfaces are made of their hits, an
/// integrator finds their light and the rays that go on, and the film keeps the result. All rays of a packet
/// take a step together, but each waits for its blocks on its own. Pixels do not depend on the order of
/// samples: see FixedRadiance. Owned by one thread.
/// Source: Purcell et al. 2002, section 3: generate, traverse, shade, then new rays.
class TileRenderer {
 public:
  /// Begins a tile and reuses the memory of the last. Requires: done(); the view's integrator needs pixels.
  void Open(std::shared_ptr<const ViewContext> view, const Tile& tile);
  /// Begins a part of a list. Requires: done(); the view's integrator needs no pixels.
  void Open(std::shared_ptr<const ViewContext> view, RayPart part);

  /// Advances every ready sample to its next ray and traces these rays. Calls
  /// `want(block, const RayBatch::Parked&)` once for each block that rays were parked on in this call.
  template <class Want>
  void Step(PinnedBlocks& pins, Want&& want) {
    if (reader_ == 0) reader_ = pins.NewReader();
    pins.LogTo(touched_.log(), reader_);
    Round(pins);
    touched_.Tidy();
    batch_.ReportParked(want);
  }
  /// Ends the tile unfinished. Blocks that its rays waited for may still be delivered.
  void Abandon();
  /// Ends the tile with holes where rays wait. Requires: the tile leaves holes; no ray is ready.
  void LeaveHoles();
  /// Makes the rays parked on `block` ready. Requires: the block is pinned during the next Step().
  void Resume(BlockKey block) { batch_.Resume(block); }

  /// Whether Step() has something to do.
  bool has_ready() const { return batch_.has_ready(); }
  /// Whether all samples have ended.
  bool done() const {
    return std::ranges::all_of(unfinished_, [](uint64_t samples) { return samples == 0; });
  }
  /// Whether only LeaveHoles() is left to do.
  bool may_leave_holes() const { return leaves_holes_ && !has_ready() && !done(); }
  const ViewContext& view() const { return *view_; }
  /// Bytes of the tile's samples and pixels.
  size_t memory_bytes() const;
  /// Takes the result; `compute_us` is left to the caller. Requires: done().
  RenderedTile Take();

 private:
  void BeginPass(RaySource& source, const Integrator& integrator);
  void BeginPixelsAfterEdges();
  PacketWork WorkOn(uint32_t packet, PinnedBlocks* pins);
  void Start(PacketWork& work);
  void LeaveHoles(uint32_t packet);
  void Round(PinnedBlocks& pins);
  void Advance(PacketWork& work);
  void Traced(PacketWork& work, uint64_t lanes, bool any);
  uint64_t TestHits(PacketWork& work, uint64_t lanes);
  void TakeHits(PacketWork& work, uint64_t lanes, SamplePacket::Stage from);
  uint64_t Miss(PacketWork& work, uint64_t lanes);
  void Shade(PacketWork& work, uint64_t lanes);
  void TakeNext(PacketWork& work, uint64_t lanes);

  std::shared_ptr<const ViewContext> view_;
  const Integrator* integrator_ = nullptr;
  bool makes_surfaces_ = true, makes_pixels_ = true, refills_ = false;
  /// Whether a packet's hits become surfaces together, once no ray is to go on behind a hole: few at a time
  /// cost as much as many. Samples of very different length do not wait for each other.
  bool gathers_ = false;
  SamplePacket::Stage first_ = SamplePacket::kTraverse;  ///< of a sample
  bool leaves_holes_ = false;
  EdgeRays edge_rays_;
  EyeRays eye_rays_;
  RayList ray_list_;
  RaySource* source_ = nullptr;  ///< one of these
  RayBatch batch_;
  std::vector<SamplePacket> samples_;
  std::vector<TextureLookups> lookups_;  ///< empty where the view has no textures
  std::vector<CutPacket> cuts_;          ///< empty where all hits count
  std::vector<TintPacket> tints_;        ///< empty where no texture tints light
  std::vector<PathPacket> paths_;        ///< empty where the integrator needs none
  PendingRays pending_;
  TileFilm film_;
  std::unique_ptr<Scratch> scratch_ = std::make_unique<Scratch>();
  uint64_t unfinished_[RayBatch::kPackets] = {};  ///< samples under way, a bit each
  uint32_t reader_ = 0;                           ///< see PinnedBlocks::LogTo(); 0: none yet
  TouchedBlocks touched_;
};

}  // namespace quarry

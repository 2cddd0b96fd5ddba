#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "tests/laboratory/machine/kernels.h"
#include "tests/laboratory/machine/oracle.h"
#include "tests/laboratory/machine/raster.h"

namespace quarry::laboratory {

/// The work of a machine. Units: counts.
struct MachineCounts {
  uint64_t rays = 0;             ///< traced: primary and others
  uint64_t steps = 0, ups = 0;   ///< of traversal: cells or nodes
  uint64_t tests = 0;            ///< rays against triangles
  uint64_t shaded = 0;           ///< hits of closest-hit rays
  uint64_t runs[kKernels] = {};  ///< rays that each kernel worked on, once a pass
  uint64_t passes[kKernels] = {};
  uint64_t places = 0;        ///< rays of the stream, summed over passes: stencil values read
  uint64_t least_passes = 0;  ///< a bound: no order of passes has fewer in the structure
  uint32_t most_steps = 0;    ///< traversal passes that one ray took part in
  uint32_t most_tests = 0;    ///< intersection passes that one ray took part in

  uint64_t all_passes() const;
  /// Passes in the structure: traverse, up, intersect.
  uint64_t structure_passes() const;
  /// The average share of rays that do useful work in a pass (table 2).
  double simd_efficiency() const;
};

/// Purcell's machine: renders a picture by kernels over streams of rays. Sums of pixels do not depend on the
/// schedule. Not thread-safe.
/// Source: Purcell et al. 2002, sections 2 and 3.
template <class A, class M>
class Machine {
 public:
  Machine(const A& accelerator, const Picture& picture, M& memory, AddressSpace& addresses)
      : picture_(picture), memory_(memory), kernels_(accelerator, picture, memory), addresses_(addresses) {
    sums_.resize(picture.pixels());
    sum_stream_ = addresses.StreamOf(sums_);
  }

  /// One kernel a pass over all rays of a tile, others masked by their stencil. `tile`: the side of tiles
  /// that are rendered to completion one after the other, pixels; 0: the whole screen.
  void RunMultipass(const Oracle& oracle, const Unrolling& unrolling, uint32_t tile);
  /// All kernels in one pass: each ray is in registers from its beginning to its end.
  void RunBranching(uint32_t tile);

  /// Memory of a run for each pixel. `rasterizes`: the eye rays' hits come from Rasterize().
  static constexpr uint64_t BytesPerPixel(const RayParts& parts, bool rasterizes) {
    constexpr uint64_t kPixelList = 3 * sizeof(uint32_t);  // while it grows, a half is copied to a new place
    return RayStreams<A>::BytesPerRay(parts) + sizeof(PixelSum) + sizeof(Taken) + kPixelList +
           sizeof(uint32_t) + (rasterizes ? kRasterBytes : 0);
  }

  const MachineCounts& counts() const { return counts_; }
  const std::vector<PixelSum>& sums() const { return sums_; }

 private:
  using Registers = RayRegisters<A>;
  std::vector<std::vector<uint32_t>> Tiles(uint32_t side) const;
  void RunTile(std::span<const uint32_t> pixels, uint32_t sample, const Oracle& oracle,
               const Unrolling& unrolling, RayStreams<A>& s);
  void Begin(std::span<const uint32_t> pixels, uint32_t sample, RayStreams<A>& s, StageCounts& stages);
  void Pass(KernelId kernel, Stage stage, std::span<const uint32_t> pixels, uint32_t sample,
            const Unrolling& unrolling, RayStreams<A>& s, StageCounts& stages);
  Stencil Run(KernelId kernel, uint32_t i, Stencil stencil, uint32_t pixel, uint32_t sample,
              const Unrolling& unrolling, RayStreams<A>& s);
  void EndGeneration();
  void Trace(uint32_t pixel, uint32_t sample, const HitState* seen);

  const Picture& picture_;
  M& memory_;
  Kernels<A, M> kernels_;
  AddressSpace& addresses_;
  std::vector<PixelSum> sums_;
  Stream<PixelSum> sum_stream_;
  MachineCounts counts_;
  std::vector<uint32_t> active_;  ///< rays of the tile that may not be done
  /// Passes of each ray since its setup, and the most of them since the last generation.
  struct Taken {
    uint32_t steps = 0, ups = 0, tests = 0;
  };
  std::vector<Taken> taken_;
  Taken most_;
};

template <class A, class M>
std::vector<std::vector<uint32_t>> Machine<A, M>::Tiles(uint32_t side) const {
  const uint32_t width = picture_.context.view.width, height = picture_.context.view.height;
  const uint32_t across = side == 0 ? width : side, down = side == 0 ? height : side;
  std::vector<std::vector<uint32_t>> tiles;
  for (uint32_t y0 = 0; y0 < height; y0 += down)
    for (uint32_t x0 = 0; x0 < width; x0 += across) {
      std::vector<uint32_t>& pixels = tiles.emplace_back();
      for (uint32_t y = y0; y < std::min(y0 + down, height); ++y)
        for (uint32_t x = x0; x < std::min(x0 + across, width); ++x) pixels.push_back(y * width + x);
    }
  return tiles;
}

template <class A, class M>
void Machine<A, M>::RunMultipass(const Oracle& oracle, const Unrolling& unrolling, uint32_t tile) {
  const auto tiles = Tiles(tile);
  RayStreams<A> streams(static_cast<uint32_t>(tiles[0].size()), picture_.parts(), addresses_);
  for (uint32_t sample = 0; sample < picture_.context.view.spp; ++sample)
    for (const auto& pixels : tiles) RunTile(pixels, sample, oracle, unrolling, streams);
}

template <class A, class M>
void Machine<A, M>::RunTile(std::span<const uint32_t> pixels, uint32_t sample, const Oracle& oracle,
                            const Unrolling& unrolling, RayStreams<A>& s) {
  StageCounts stages;
  Begin(pixels, sample, s, stages);
  Stage last = Stage::kSetup;
  const auto of = [&](Stage stage) { return stages[stage]; };
  while (of(Stage::kDone) < pixels.size()) {
    if (of(Stage::kSetup) > 0) {
      Pass(KernelId::kSetup, last = Stage::kSetup, pixels, sample, unrolling, s, stages);
    } else if (stages.in_structure() > 0) {
      last = ChooseStage(oracle, stages, last);
      const KernelId kernel = last == Stage::kTraverse ? KernelId::kTraverse
                              : last == Stage::kUp     ? KernelId::kUp
                                                       : KernelId::kIntersect;
      Pass(kernel, last, pixels, sample, unrolling, s, stages);
    } else {
      EndGeneration();
      Pass(KernelId::kColor, last = Stage::kShade, pixels, sample, unrolling, s, stages);
      if (of(Stage::kShade) > 0) Pass(KernelId::kShadow, Stage::kShade, pixels, sample, unrolling, s, stages);
      std::erase_if(active_, [&](uint32_t i) { return s.stencil.data[i].stage() == Stage::kDone; });
    }
  }
}

/// Generates the eye rays of a tile, or takes the hits that rasterising has found.
template <class A, class M>
void Machine<A, M>::Begin(std::span<const uint32_t> pixels, uint32_t sample, RayStreams<A>& s,
                          StageCounts& stages) {
  active_.clear();
  taken_.assign(pixels.size(), {});
  most_ = {};
  std::vector<HitState> seen;
  if (picture_.renderer == Renderer::kShadow) seen = Rasterize(picture_, pixels, sample);
  Enter(memory_, KernelId::kGenerate);
  ++counts_.passes[static_cast<uint32_t>(KernelId::kGenerate)];
  counts_.runs[static_cast<uint32_t>(KernelId::kGenerate)] += pixels.size();
  counts_.places += pixels.size();
  for (uint32_t i = 0; i < pixels.size(); ++i) {
    Stencil stencil = kernels_.Generate(s, i, pixels[i], sample, sum_stream_);
    if (!seen.empty() && stencil.stage() == Stage::kSetup) {
      s.hit.data[i] = seen[i];
      stencil = s.stencil.data[i] = stencil.At(Stage::kShade);
    }
    ++stages[stencil.stage()];
    if (stencil.stage() != Stage::kDone) active_.push_back(i);
  }
}

template <class A, class M>
void Machine<A, M>::Pass(KernelId kernel, Stage stage, std::span<const uint32_t> pixels, uint32_t sample,
                         const Unrolling& unrolling, RayStreams<A>& s, StageCounts& stages) {
  Enter(memory_, kernel);
  uint64_t runs = 0;
  for (const uint32_t i : active_) {
    const Stencil stencil = s.stencil.data[i];
    if (stencil.stage() != stage) continue;
    if (kernel == KernelId::kColor && stencil.kind() != RayKind::kClosest) continue;
    if (kernel == KernelId::kShadow && stencil.kind() == RayKind::kClosest) continue;
    const Stencil after = Run(kernel, i, stencil, pixels[i], sample, unrolling, s);
    --stages[stage];
    ++stages[after.stage()];
    ++runs;
  }
  // A kernel without rays is not run: the counters of stages tell.
  if (runs == 0) return;
  counts_.runs[static_cast<uint32_t>(kernel)] += runs;
  ++counts_.passes[static_cast<uint32_t>(kernel)];
  counts_.places += pixels.size();
}

template <class A, class M>
Stencil Machine<A, M>::Run(KernelId kernel, uint32_t i, Stencil stencil, uint32_t pixel, uint32_t sample,
                           const Unrolling& unrolling, RayStreams<A>& s) {
  Taken& taken = taken_[i];
  uint32_t done = 0;
  switch (kernel) {
    case KernelId::kSetup:
      ++counts_.rays;
      taken = {};
      return kernels_.Setup(s, i, stencil);
    case KernelId::kTraverse:
      stencil = kernels_.Traverse(s, i, stencil, unrolling.traverse, done);
      counts_.steps += done;
      most_.steps = std::max(most_.steps, ++taken.steps);
      return stencil;
    case KernelId::kUp:
      ++counts_.ups;
      most_.ups = std::max(most_.ups, ++taken.ups);
      return kernels_.Up(s, i, stencil);
    case KernelId::kIntersect:
      stencil = kernels_.Intersect(s, i, stencil, unrolling.intersect, done);
      counts_.tests += done;
      most_.tests = std::max(most_.tests, ++taken.tests);
      return stencil;
    case KernelId::kShadow:
      return kernels_.Shadow(s, i, stencil, pixel, sample, sum_stream_);
    default:
      counts_.shaded += s.hit.data[i].triangle != kNoTriangle ? 1 : 0;
      return kernels_.Color(s, i, stencil, pixel, sample, sum_stream_);
  }
}

/// All rays have left the structure: each kernel had to run as often as its busiest ray needed it.
template <class A, class M>
void Machine<A, M>::EndGeneration() {
  counts_.least_passes += uint64_t{most_.steps} + most_.ups + most_.tests;
  counts_.most_steps = std::max(counts_.most_steps, most_.steps);
  counts_.most_tests = std::max(counts_.most_tests, most_.tests);
  most_ = {};
}

template <class A, class M>
void Machine<A, M>::RunBranching(uint32_t tile) {
  for (uint32_t sample = 0; sample < picture_.context.view.spp; ++sample)
    for (const auto& pixels : Tiles(tile)) {
      std::vector<HitState> seen;
      if (picture_.renderer == Renderer::kShadow) seen = Rasterize(picture_, pixels, sample);
      for (size_t i = 0; i < pixels.size(); ++i) Trace(pixels[i], sample, seen.empty() ? nullptr : &seen[i]);
      counts_.places += pixels.size();
    }
  counts_.passes[static_cast<uint32_t>(KernelId::kGenerate)] = 1;
}

template <class A, class M>
void Machine<A, M>::Trace(uint32_t pixel, uint32_t sample, const HitState* seen) {
  Registers r;
  PixelSum sum;
  LocalPending pending{{}, r.pending};
  const auto run = [&](KernelId kernel) {
    Enter(memory_, kernel);
    ++counts_.runs[static_cast<uint32_t>(kernel)];
  };
  run(KernelId::kGenerate);
  if (kernels_.GenerateBody(pixel, sample, r, sum) && seen) {
    r.hit = *seen;
    r.stencil = r.stencil.At(Stage::kShade);
  }
  for (;;) {
    switch (r.stencil.stage()) {
      case Stage::kSetup:
        run(KernelId::kSetup);
        ++counts_.rays;
        kernels_.SetupBody(r);
        break;
      case Stage::kTraverse:
        run(KernelId::kTraverse);
        ++counts_.steps;
        kernels_.TraverseBody(r);
        break;
      case Stage::kUp:
        run(KernelId::kUp);
        ++counts_.ups;
        kernels_.UpBody(r);
        break;
      case Stage::kIntersect:
        run(KernelId::kIntersect);
        if (r.range.next != r.range.end) {
          ++counts_.tests;
          kernels_.TestBody(r);
        }
        if (r.stencil.stage() == Stage::kIntersect && r.range.next == r.range.end) kernels_.LeaveBody(r);
        break;
      case Stage::kShade:
        if (r.stencil.kind() == RayKind::kClosest) {
          run(KernelId::kColor);
          counts_.shaded += r.hit.triangle != kNoTriangle ? 1 : 0;
          kernels_.ColorBody(pixel, sample, r, pending, sum);
        } else {
          run(KernelId::kShadow);
          kernels_.ShadowBody(pixel, sample, r, pending, sum);
        }
        break;
      case Stage::kDone: {
        PixelSum all = sums_[pixel];
        for (int c = 0; c < 3; ++c) all.at[c].Add(sum.at[c]);
        memory_.Store(sum_stream_, pixel, all);
        return;
      }
    }
  }
}

}  // namespace quarry::laboratory

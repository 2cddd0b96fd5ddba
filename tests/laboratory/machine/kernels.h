#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "common/kdtree/trace/kernel_parts.h"
#include "tests/laboratory/machine/picture.h"
#include "tests/laboratory/machine/ray_state.h"
#include "tests/laboratory/machine/shade.h"

// The machine's kernels. Each has a body over one ray in registers, which the branching machine runs in a
// loop, and a multipass form that loads from streams the parts of the ray that the body reads, and stores the
// parts that it changes. They are not inlined, so that their instructions can be counted one by one.

namespace quarry::laboratory {

/// Kernels of table 1 in Purcell et al. 2002; kUp is Foley & Sugerman's.
enum class KernelId : uint32_t { kGenerate, kSetup, kTraverse, kUp, kIntersect, kColor, kShadow };
inline constexpr uint32_t kKernels = 7;
inline constexpr std::array<const char*, kKernels> kKernelNames = {"generate",  "setup", "traverse", "up",
                                                                   "intersect", "color", "shadow"};

/// Steps that a pass takes per ray: loops that are unrolled.
struct Unrolling {
  uint32_t traverse = 1, intersect = 1;
};

/// Tells the memory for which kernel it works, if it wants to know.
template <class M>
inline void Enter(M& memory, KernelId kernel) {
  if constexpr (requires { memory.SetKernel(0u); }) memory.SetKernel(static_cast<uint32_t>(kernel));
}

/// Rays for later in registers.
struct LocalPending {
  void Push(const PendingRay& ray) { rays[count++] = ray; }
  PendingRay Pop() { return rays[--count]; }
  PendingRay rays[kMostPending];
  uint32_t& count;
};

/// Rays for later in a stream: each is stored and loaded alone.
template <class M>
struct StreamPending {
  void Push(const PendingRay& ray) { memory.Store(list, i * kMostPending + count++, ray); }
  PendingRay Pop() { return memory.Load(list, i * kMostPending + --count); }
  M& memory;
  const Stream<PendingRay>& list;
  size_t i;
  uint32_t& count;
};

/// The kernels over an acceleration structure `A` and a memory `M`. Not thread-safe.
template <class A, class M>
class Kernels {
 public:
  using Registers = RayRegisters<A>;

  Kernels(const A& accelerator, const Picture& picture, M& memory)
      : accelerator_(accelerator), picture_(picture), memory_(memory) {}

  // Bodies.

  /// The eye ray of a sample. Returns: false where it misses the scene's box; the background is then added.
  [[gnu::noinline]] bool GenerateBody(uint32_t pixel, uint32_t sample, Registers& r, PixelSum& sum) {
    const PrimaryRay ray = EyeRayOf(picture_, pixel, sample);
    for (int a = 0; a < 3; ++a) {
      r.ray.origin[a] = ray.origin[a];
      r.ray.direction[a] = ray.direction[a];
    }
    r.hit = {NextBelow(kInfinity), 0, 0, kNoTriangle};
    r.bound = {0, 0};
    r.path = {glm::vec3(1), kPrimaryPath, 0};
    r.pending = 0;
    r.stencil = Stencil::Of(ray.misses ? Stage::kDone : Stage::kSetup, RayKind::kClosest);
    if (ray.misses) sum.Add(picture_.context.view.background);
    return !ray.misses;
  }

  [[gnu::noinline]] void SetupBody(Registers& r) {
    const float t = r.bound.t > 0 ? ResumeBefore(r.bound.t) : 0;
    r.stencil = After(r.stencil, accelerator_.Setup(memory_, r.ray, t, r.hit.t, r.constant, r.state));
  }
  [[gnu::noinline]] void TraverseBody(Registers& r) {
    r.stencil = After(r.stencil, accelerator_.Step(memory_, r.constant, r.state, r.range));
  }
  [[gnu::noinline]] void UpBody(Registers& r) {
    r.stencil = After(r.stencil, accelerator_.Up(memory_, r.constant, r.state));
  }
  /// Tests the next triangle of the list, which is not empty. A shadow ray that an opaque triangle stops goes
  /// to kShade.
  [[gnu::noinline]] void TestBody(Registers& r) {
    const uint32_t triangle = memory_.Fetch(accelerator_.list(), r.range.next++);
    const RayFrame<ScalarLane> frame = MakeRayFrame<ScalarLane>(r.ray.origin, r.ray.direction);
    MovedVertex<ScalarLane> moved[3];
    for (int c = 0; c < 3; ++c) {
      const Float3& p = memory_.Fetch(picture_.scene.corner(c), triangle);
      float x = p.x - frame.origin[0], y = p.y - frame.origin[1], z = p.z - frame.origin[2];
      Rotate<ScalarLane>(frame, x, y, z);
      moved[c] = MoveVertex<ScalarLane>(frame, x, y, z);
    }
    RayBest<ScalarLane> best{r.hit.t, r.hit.b1, r.hit.b2, r.hit.triangle, 0, 0};
    NoStatistics none;
    const RayBound<ScalarLane> bound{r.bound.t, r.bound.triangle};
    if (!TestMoved<ScalarLane>(frame, moved[0], moved[1], moved[2], triangle, 0, 0, true, bound, best, none))
      return;
    if (r.stencil.kind() == RayKind::kAny) {
      if (picture_.has_see_through &&
          picture_.lets_light_through[memory_.Fetch(picture_.scene.materials(), triangle).material()] != 0) {
        r.stencil = Stencil::Of(r.stencil.stage(), RayKind::kAny, true);
        return;
      }
      r.stencil = r.stencil.At(Stage::kShade);
    }
    r.hit = {best.t, best.b1, best.b2, best.triangle};
  }
  /// Goes on from a list that is tested.
  [[gnu::noinline]] void LeaveBody(Registers& r) {
    r.stencil = After(r.stencil, accelerator_.Leave(memory_, r.constant, r.state, r.hit.t));
  }
  template <class Pending>
  [[gnu::noinline]] void ColorBody(uint32_t pixel, uint32_t sample, Registers& r, Pending& pending,
                                   PixelSum& sum) {
    Shader<A, M, Pending>(picture_, memory_, pixel, sample, r, pending, sum).Color();
  }
  template <class Pending>
  [[gnu::noinline]] void ShadowBody(uint32_t pixel, uint32_t sample, Registers& r, Pending& pending,
                                    PixelSum& sum) {
    Shader<A, M, Pending>(picture_, memory_, pixel, sample, r, pending, sum).Shadow();
  }

  // Multipass forms, over ray `i` of the streams. Requires: its stage is the kernel's. Return the new
  // stencil.

  [[gnu::noinline]] Stencil Generate(RayStreams<A>& s, size_t i, uint32_t pixel, uint32_t sample,
                                     const Stream<PixelSum>& sums) {
    Registers r;
    PixelSum sum;
    if (!GenerateBody(pixel, sample, r, sum)) {
      AddTo(sums, pixel, sum);
    } else {
      memory_.Store(s.ray, i, r.ray);
      memory_.Store(s.hit, i, r.hit);
    }
    if (picture_.renderer != Renderer::kRaycast) {
      memory_.Store(s.path, i, r.path);
      memory_.Store(s.pending, i, r.pending);
    }
    return Put(s, i, r.stencil);
  }
  [[gnu::noinline]] Stencil Setup(RayStreams<A>& s, size_t i, Stencil stencil) {
    Registers r = Load(s, i, stencil);
    SetupBody(r);
    memory_.Store(s.constant, i, r.constant);
    memory_.Store(s.state, i, r.state);
    return Put(s, i, r.stencil);
  }
  /// Returns in `steps` the steps taken.
  [[gnu::noinline]] Stencil Traverse(RayStreams<A>& s, size_t i, Stencil stencil, uint32_t most,
                                     uint32_t& steps) {
    Registers r;
    r.stencil = stencil;
    r.constant = memory_.Load(s.constant, i);
    r.state = memory_.Load(s.state, i);
    do {
      TraverseBody(r);
      ++steps;
    } while (--most > 0 && r.stencil.stage() == Stage::kTraverse);
    memory_.Store(s.state, i, r.state);
    if (r.stencil.stage() == Stage::kIntersect) memory_.Store(s.range, i, r.range);
    return Put(s, i, r.stencil);
  }
  [[gnu::noinline]] Stencil Up(RayStreams<A>& s, size_t i, Stencil stencil) {
    Registers r;
    r.stencil = stencil;
    r.constant = memory_.Load(s.constant, i);
    r.state = memory_.Load(s.state, i);
    UpBody(r);
    memory_.Store(s.state, i, r.state);
    return Put(s, i, r.stencil);
  }
  /// Returns in `tests` the triangles tested.
  [[gnu::noinline]] Stencil Intersect(RayStreams<A>& s, size_t i, Stencil stencil, uint32_t most,
                                      uint32_t& tests) {
    Registers r = Load(s, i, stencil);
    r.range = memory_.Load(s.range, i);
    for (; most > 0 && r.range.next != r.range.end && r.stencil.stage() == Stage::kIntersect; --most) {
      TestBody(r);
      ++tests;
    }
    memory_.Store(s.hit, i, r.hit);
    if (r.stencil.stage() != Stage::kIntersect) return Put(s, i, r.stencil);
    if (r.range.next != r.range.end) {
      memory_.Store(s.range, i, r.range);
      return Put(s, i, r.stencil);
    }
    r.constant = memory_.Load(s.constant, i);
    r.state = memory_.Load(s.state, i);
    LeaveBody(r);
    memory_.Store(s.state, i, r.state);
    return Put(s, i, r.stencil);
  }
  [[gnu::noinline]] Stencil Color(RayStreams<A>& s, size_t i, Stencil stencil, uint32_t pixel,
                                  uint32_t sample, const Stream<PixelSum>& sums) {
    Registers r = LoadPath(s, i, stencil);
    PixelSum sum;
    StreamPending<M> pending{memory_, s.list, i, r.pending};
    ColorBody(pixel, sample, r, pending, sum);
    AddTo(sums, pixel, sum);
    return StorePath(s, i, r);
  }
  [[gnu::noinline]] Stencil Shadow(RayStreams<A>& s, size_t i, Stencil stencil, uint32_t pixel,
                                   uint32_t sample, const Stream<PixelSum>& sums) {
    Registers r = LoadPath(s, i, stencil);
    r.lit = memory_.Load(s.lit, i);
    PixelSum sum;
    StreamPending<M> pending{memory_, s.list, i, r.pending};
    ShadowBody(pixel, sample, r, pending, sum);
    AddTo(sums, pixel, sum);
    return StorePath(s, i, r);
  }

 private:
  static Stencil After(Stencil stencil, StepOutcome outcome) {
    switch (outcome) {
      case StepOutcome::kOn:
        return stencil.At(Stage::kTraverse);
      case StepOutcome::kUp:
        return stencil.At(Stage::kUp);
      case StepOutcome::kList:
        return stencil.At(Stage::kIntersect);
      default:
        return stencil.At(Stage::kShade);
    }
  }

  Stencil Put(RayStreams<A>& s, size_t i, Stencil stencil) {
    memory_.Store(s.stencil, i, stencil);
    return stencil;
  }
  /// The ray, its hit, and its bound if it is of a kind that has one.
  Registers Load(RayStreams<A>& s, size_t i, Stencil stencil) {
    Registers r;
    r.stencil = stencil;
    r.ray = memory_.Load(s.ray, i);
    r.hit = memory_.Load(s.hit, i);
    if (stencil.kind() == RayKind::kPassing) r.bound = memory_.Load(s.bound, i);
    return r;
  }
  Registers LoadPath(RayStreams<A>& s, size_t i, Stencil stencil) {
    Registers r = Load(s, i, stencil);
    r.path = {glm::vec3(1), kPrimaryPath, 0};
    if (picture_.renderer == Renderer::kRaycast) return r;
    r.path = memory_.Load(s.path, i);
    r.pending = memory_.Load(s.pending, i);
    return r;
  }
  Stencil StorePath(RayStreams<A>& s, size_t i, const Registers& r) {
    if (r.stencil.stage() != Stage::kDone) {
      memory_.Store(s.ray, i, r.ray);
      memory_.Store(s.hit, i, r.hit);
      memory_.Store(s.path, i, r.path);
      memory_.Store(s.pending, i, r.pending);
      if (r.stencil.kind() != RayKind::kClosest) memory_.Store(s.lit, i, r.lit);
      if (r.stencil.kind() == RayKind::kPassing) memory_.Store(s.bound, i, r.bound);
    }
    return Put(s, i, r.stencil);
  }
  void AddTo(const Stream<PixelSum>& sums, uint32_t pixel, const PixelSum& more) {
    PixelSum sum = memory_.Load(sums, pixel);
    for (int c = 0; c < 3; ++c) sum.at[c].Add(more.at[c]);
    memory_.Store(sums, pixel, sum);
  }

  const A& accelerator_;
  const Picture& picture_;
  M& memory_;
};

}  // namespace quarry::laboratory

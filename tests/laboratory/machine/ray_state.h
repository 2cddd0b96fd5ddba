#pragma once

#include <cstdint>
#include <vector>

#include "common/engine/integrators/bounce.h"
#include "common/engine/surfaces/surface.h"
#include "common/kdtree/ray.h"
#include "common/math/fixed_radiance.h"
#include "tests/laboratory/memory.h"
#include "tests/laboratory/structures/accelerator.h"

// The state of rays between kernels, in streams. Each kernel loads and stores the parts that it needs.

namespace quarry::laboratory {

/// The state of a ray, in the low bits of its stencil value. Purcell et al. 2002, section 3, has traversing,
/// intersecting, shading and done; setup and kUp are kernels of their own here as in Foley & Sugerman 2005.
enum class Stage : uint8_t { kSetup, kTraverse, kUp, kIntersect, kShade, kDone };
inline constexpr uint32_t kStages = 6;

/// The purpose of a ray, in the next bits.
enum class RayKind : uint8_t {
  kClosest,  ///< finds the nearest hit
  kAny,      ///< a shadow ray: ends at any opaque hit
  kPassing,  ///< a shadow ray that goes from one see-through surface to the next
};

/// The stencil value of a ray, 8 bits.
struct Stencil {
  uint8_t bits = 0;

  static Stencil Of(Stage stage, RayKind kind, bool met_see_through = false) {
    return {static_cast<uint8_t>(static_cast<uint32_t>(stage) | static_cast<uint32_t>(kind) << 3 |
                                 static_cast<uint32_t>(met_see_through) << 5)};
  }
  Stage stage() const { return static_cast<Stage>(bits & 7); }
  RayKind kind() const { return static_cast<RayKind>(bits >> 3 & 3); }
  bool met_see_through() const { return (bits >> 5 & 1) != 0; }
  Stencil At(Stage stage) const { return Of(stage, kind(), met_see_through()); }
};

/// The nearest hit so far; without a triangle, t is the greatest t at which a hit would count.
struct HitState {
  float t, b1, b2;
  uint32_t triangle;  ///< its place in the scene
};

/// Exclusive lower bound of hits, see Ray; t = 0: none.
struct BoundState {
  float t;
  uint32_t triangle;
};

/// The path that a ray belongs to.
struct PathState {
  glm::vec3 weight;
  uint32_t code, depth;
};

/// The state of a lit surface while its shadow rays are under way.
struct LitState {
  Surface surface;
  glm::vec3 light;  ///< that the present shadow ray adds if nothing is in its way
  uint32_t next_light, passed;
};

/// A ray that is to be traced later.
struct PendingRay {
  RayStart ray;
  PathState path;
};
/// As in TileRenderer: the newest goes first, so that this many at most wait.
inline constexpr size_t kMostPending = kMostBounces + 1;

/// A pixel's sum, exact, so that it does not depend on the order of its terms.
struct PixelSum {
  FixedRadiance at[3];
  void Add(const glm::vec3& radiance) {
    for (int c = 0; c < 3; ++c) at[c].Add(radiance[c]);
  }
};

/// All of a ray, as a kernel has it in registers.
template <class A>
struct RayRegisters {
  Stencil stencil;
  RayStart ray = {};
  HitState hit = {};
  BoundState bound = {};
  typename A::Constant constant = {};
  typename A::State state = {};
  TriangleRange range;
  PathState path = {};
  LitState lit = {};
  uint32_t pending = 0;
};

/// The parts of a ray's state that not every picture needs.
struct RayParts {
  bool paths = true;   ///< rays go on from hits: path, lit surface, number of pending rays
  bool bounds = true;  ///< shadow rays go through see-through surfaces
  bool lists = true;   ///< rays wait for later
};

/// The streams of `count` rays. Streams that the picture does not need have no memory. Their addresses stay
/// taken, so that all renderers' streams displace one another in a cache alike.
template <class A>
class RayStreams {
 public:
  RayStreams(uint32_t count, const RayParts& parts, AddressSpace& addresses) {
    const auto make = [&](auto& stream, auto& data, bool needed = true, size_t elements = 1,
                          DataKind kind = DataKind::kState) {
      const size_t size = count * elements;
      if (needed) data.resize(size);
      stream = {data.data(), addresses.Take(size * sizeof(data[0])), kind};
    };
    make(stencil, stencils_, true, 1, DataKind::kStencil);
    make(ray, rays_);
    make(hit, hits_);
    make(bound, bounds_, parts.bounds);
    make(constant, constants_);
    make(state, states_);
    make(range, ranges_);
    make(path, paths_, parts.paths);
    make(lit, lits_, parts.paths);
    make(pending, pendings_, parts.paths);
    make(list, lists_, parts.lists, kMostPending);
  }
  RayStreams(const RayStreams&) = delete;
  /// Memory of each ray.
  static constexpr uint64_t BytesPerRay(const RayParts& parts) {
    return sizeof(Stencil) + sizeof(RayStart) + sizeof(HitState) + (parts.bounds ? sizeof(BoundState) : 0) +
           sizeof(typename A::Constant) + sizeof(typename A::State) + sizeof(TriangleRange) +
           (parts.paths ? sizeof(PathState) + sizeof(LitState) + sizeof(uint32_t) : 0) +
           (parts.lists ? kMostPending * sizeof(PendingRay) : 0);
  }
  uint32_t size() const { return static_cast<uint32_t>(stencils_.size()); }

  Stream<Stencil> stencil;
  Stream<RayStart> ray;
  Stream<HitState> hit;
  Stream<BoundState> bound;
  Stream<typename A::Constant> constant;
  Stream<typename A::State> state;
  Stream<TriangleRange> range;
  Stream<PathState> path;
  Stream<LitState> lit;
  Stream<uint32_t> pending;
  Stream<PendingRay> list;  ///< kMostPending a ray

 private:
  std::vector<Stencil> stencils_;
  std::vector<RayStart> rays_;
  std::vector<HitState> hits_;
  std::vector<BoundState> bounds_;
  std::vector<typename A::Constant> constants_;
  std::vector<typename A::State> states_;
  std::vector<TriangleRange> ranges_;
  std::vector<PathState> paths_;
  std::vector<LitState> lits_;
  std::vector<uint32_t> pendings_;
  std::vector<PendingRay> lists_;
};

}  // namespace quarry::laboratory

#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/ray_source.h"
#include "common/kdtree/trace/kernel_parts.h"
#include "tests/laboratory/variants/simt.h"

namespace quarry::laboratory {

/// The rays of one vector, whatever their structure. Arrays are vectors in memory, so that single lanes can
/// be refilled.
template <class L>
struct SimtLanes {
  static constexpr uint32_t kLanes = L::kLanes;
  using Float = typename L::Float;
  using Int = typename L::Int;
  using Mask = typename L::Mask;

  alignas(64) float origin[3][kLanes] = {};
  alignas(64) float direction[3][kLanes] = {};
  alignas(64) float reciprocal[3][kLanes] = {};
  alignas(64) float shift[3][kLanes] = {};
  alignas(64) float shear_x[kLanes] = {};
  alignas(64) float shear_y[kLanes] = {};
  alignas(64) float scale_z[kLanes] = {};
  alignas(64) uint32_t largest_axis[kLanes] = {};
  alignas(64) float t_end[kLanes] = {};
  alignas(64) float t_exit[kLanes] = {};  ///< of the cell or leaf
  alignas(64) uint32_t next[kLanes] = {};
  alignas(64) uint32_t end[kLanes] = {};  ///< of the list that the lane tests
  alignas(64) float hit_t[kLanes] = {};
  alignas(64) float b1[kLanes] = {};
  alignas(64) float b2[kLanes] = {};
  alignas(64) uint32_t triangle[kLanes] = {};
  RayPacket* packet[kLanes] = {};
  uint32_t index[kLanes] = {};
  // Lanes by their next kernel, as bits; a lane in none of them is idle.
  uint32_t on = 0, up = 0, list = 0;

  /// Takes the ray at packet[i], index[i] into lane i. Returns: the t at which it enters the scene.
  float Load(uint32_t i, const SimtScene& scene) {
    const RayPacket& rays = *packet[i];
    const uint32_t r = index[i];
    const RayFrame<ScalarLane> frame = LoadFrame<ScalarLane>(rays, r);
    for (int a = 0; a < 3; ++a) {
      origin[a][i] = frame.origin[a];
      direction[a][i] = rays.direction[a][r];
      reciprocal[a][i] = frame.reciprocal[a];
      shift[a][i] = frame.shift[a];
    }
    shear_x[i] = frame.shear_x;
    shear_y[i] = frame.shear_y;
    scale_z[i] = frame.scale_z;
    largest_axis[i] = frame.z_is_x ? 0 : frame.z_is_y ? 1 : 2;
    hit_t[i] = rays.hit_t[r];
    triangle[i] = kNoTriangle;
    float t = 0;
    t_end[i] = hit_t[i];
    ClipToBox<ScalarLane>(frame, scene.lower, scene.upper, t, t_end[i]);
    return t;
  }

  /// Writes the hits of `lanes` back to their packets.
  void Finish(uint32_t lanes) {
    for (; lanes != 0; lanes &= lanes - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(lanes));
      RayPacket& rays = *packet[i];
      const uint32_t r = index[i];
      rays.hit_t[r] = hit_t[i];
      rays.triangle[r] = triangle[i];
      rays.b1[r] = b1[i];
      rays.b2[r] = b2[i];
    }
  }

  /// Tests the next triangle of each lane of `list`. Returns: the lanes whose lists end, taken from `list`.
  uint32_t Test(const SimtScene& scene, const uint32_t* entries) {
    alignas(64) uint32_t places[kLanes];
    const float* at[3][kLanes];
    const auto some = static_cast<uint32_t>(std::countr_zero(list));
#pragma GCC unroll 16
    for (uint32_t i = 0; i < kLanes; ++i) {
      const uint32_t lane = (list >> i & 1u) != 0 ? i : some;
      places[i] = entries[next[lane]];
      for (uint32_t k = 0; k < 3; ++k) at[k][i] = scene.corners + size_t{12} * places[i] + 4 * k;
    }
    const Mask testing = L::FromBits(list);
    const Int largest = L::LoadInt(largest_axis);
    RayFrame<L> frame;
    frame.shear_x = L::Load(shear_x);
    frame.shear_y = L::Load(shear_y);
    frame.scale_z = L::Load(scale_z);
    frame.z_is_x = L::EqualInt(largest, L::SetInt(0));
    frame.z_is_y = L::EqualInt(largest, L::SetInt(1));
    MovedVertex<L> moved[3];
    for (int k = 0; k < 3; ++k) {
      Float x, y, z, unused;
      L::Gather4(at[k], 0, x, y, z, unused);
      x = x - L::Load(origin[0]);
      y = y - L::Load(origin[1]);
      z = z - L::Load(origin[2]);
      Rotate<L>(frame, x, y, z);
      moved[k] = MoveVertex<L>(frame, x, y, z);
    }
    const Mask may = MayContain<L>(moved[0], moved[1], moved[2], testing);
    if (!L::None(may)) {
      const Int none = L::SetInt(0);
      RayBest<L> best{L::Load(hit_t), L::Load(b1), L::Load(b2), L::LoadInt(triangle), none, none};
      const TriangleHit<L> found = HitMoved<L>(frame, moved[0], moved[1], moved[2], may);
      if (!L::None(Keep<L>(found, L::LoadInt(places), none, none, best))) {
        L::Store(best.t, hit_t);
        L::Store(best.b1, b1);
        L::Store(best.b2, b2);
        L::StoreInt(best.triangle, triangle);
      }
    }
    const Int after = L::AddInt(L::LoadInt(next), L::SelectInt(testing, L::SetInt(1), L::SetInt(0)));
    L::StoreInt(after, next);
    const uint32_t done = list & ~L::Bits(L::LessInt(after, L::LoadInt(end)));
    list &= ~done;
    return done;
  }
};

/// Traces rays through a structure. `Way`: a structure for lanes, with
///   Begin(i, t)     begins lane i at t;
///   Step(few)       steps lanes of `on`, at least once, until no more than `few` are left; they go to
///   `list`,
///                   or, from an empty leaf, into the result: lanes to leave;
///   Up()            one step of the lanes of `up`;
///   Leave(lanes)    returns the lanes whose rays end; the rest are in `on` or `up`.
template <class L, class Way>
class SimtTracer {
 public:
  static constexpr uint32_t kLanes = L::kLanes;
  static constexpr uint32_t kWorthAVector = (kLanes + 3) / 4;  ///< lanes to refill, to test, to climb

  template <class Structure>
  SimtTracer(const SimtScene& scene, const Structure& structure, SimtRays rays)
      : scene_(scene), source_{rays.packets, rays.active, rays.count}, way_(scene, structure, lanes_) {}

  void Run() {
    for (;;) {
      const uint32_t idle = L::kAllLanes & ~(lanes_.on | lanes_.list | lanes_.up);
      if (static_cast<uint32_t>(std::popcount(idle)) >= kWorthAVector) Refill(idle);
      const uint32_t live = lanes_.on | lanes_.list | lanes_.up;
      if (live == 0) return;
      if (lanes_.on != 0) Leave(way_.Step(static_cast<uint32_t>(std::popcount(live)) / 2));
      // Lanes wait for others only while a lane steps.
      while (lanes_.list != 0 && (Worth(lanes_.list) || lanes_.on == 0))
        Leave(lanes_.Test(scene_, way_.entries()));
      while (lanes_.up != 0 && (Worth(lanes_.up) || lanes_.on == 0)) way_.Up();
    }
  }

 private:
  static bool Worth(uint32_t lanes) { return static_cast<uint32_t>(std::popcount(lanes)) >= kWorthAVector; }

  void Leave(uint32_t lanes) {
    if (lanes != 0) lanes_.Finish(way_.Leave(lanes));
  }
  void Refill(uint32_t idle) {
    for (; idle != 0; idle &= idle - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(idle));
      while (source_.Next(lanes_.packet[i], lanes_.index[i])) {
        const float t = lanes_.Load(i, scene_);
        if (!(t < lanes_.t_end[i])) {
          lanes_.Finish(1u << i);
          continue;
        }
        way_.Begin(i, t);
        lanes_.on |= 1u << i;
        break;
      }
    }
  }

  const SimtScene& scene_;
  RaySource source_;
  SimtLanes<L> lanes_;
  Way way_;
};

/// Every ray against every triangle: vectors of rays, a triangle at a time, some hundred triangles for the
/// rays of a packet before the next. Source: the first scheme of Foley & Sugerman 2005, section 3.
template <class L>
void SimtBrute(const SimtScene& scene, SimtRays rays) {
  using Float = typename L::Float;
  constexpr uint32_t kBlock = 512;  // 24 KiB: they stay in the first-level cache
  for (uint32_t p = 0; p < rays.count; ++p) {
    RayPacket& packet = rays.packets[p];
    for (uint32_t first = 0; first < scene.triangles; first += kBlock) {
      const uint32_t last = first + kBlock < scene.triangles ? first + kBlock : scene.triangles;
      for (uint32_t r = 0; r < RayPacket::kRays; r += L::kLanes) {
        const auto active = L::FromBits(static_cast<uint32_t>(rays.active[p] >> r) & L::kAllLanes);
        if (L::None(active)) continue;
        const RayFrame<L> frame = LoadFrame<L>(packet, r);
        RayBest<L> best = LoadBest<L>(packet, r);
        const auto none = L::SetInt(0);
        for (uint32_t k = first; k < last; ++k) {
          MovedVertex<L> moved[3];
          for (uint32_t c = 0; c < 3; ++c) {
            const float* point = scene.corners + size_t{12} * k + 4 * c;
            Float x = L::Set(point[0]) - frame.origin[0], y = L::Set(point[1]) - frame.origin[1],
                  z = L::Set(point[2]) - frame.origin[2];
            Rotate<L>(frame, x, y, z);
            moved[c] = MoveVertex<L>(frame, x, y, z);
          }
          const auto may = MayContain<L>(moved[0], moved[1], moved[2], active);
          if (L::None(may)) continue;
          Keep<L>(HitMoved<L>(frame, moved[0], moved[1], moved[2], may), L::SetInt(k), none, none, best);
        }
        StoreBest<L>(best, packet, r);
      }
    }
  }
}

}  // namespace quarry::laboratory

#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/trace/stream_memory.h"

// A stream's rays on their way out of packets and back: a vector of rays at a time, transposed.

namespace quarry {

/// Takes rays out of packets into a stream and gives them back. `L`: lanes that are rays. One object serves
/// one stream.
template <class L, bool kAnyHit>
class StreamRays {
 public:
  StreamRays(const TopTree& top, StreamMemory& memory)
      : top_(top), rays_(memory.rays.get()), hits_(memory.hits.get()) {}

  /// Takes up the rays that `active` names. Rays of an octant (bit a of its number: down along axis a) lie
  /// side by side, in the order of packets. Out: `end`, one past each octant's rays; `places`, each ray's
  /// place. Returns the number of rays. Requires: room for them in `places` and the memory.
  uint32_t TakeUp(const RayPacket* packets, const uint64_t* active, uint32_t count, uint32_t (&end)[8],
                  uint32_t* places) {
    std::fill_n(end, 8, 0u);  // an octant's number of rays, then its begin, then its end
    for (uint32_t p = 0; p < count; ++p) {
      if (p + 2 < count && active[p + 2] != 0) L::PrefetchFar(&packets[p + 2], RayPacket::Bytes(kAnyHit));
      CountOctants(packets[p], active[p], end);
    }
    uint32_t n = 0;
    for (uint32_t& e : end) {
      const uint32_t of_octant = e;
      e = n;
      n += of_octant;
    }
    for (uint32_t p = 0; p < count; ++p)
      if (active[p] != 0) places = TakeUp(packets[p], p, active[p], end, places);
    return n;
  }

  /// Writes the rays' results to their packets. `places`: as TakeUp has written them. `active`: out, the rays
  /// that are yet to be traced.
  void GiveBack(RayPacket* packets, uint64_t* active, uint32_t count, const uint32_t* places) {
    for (uint32_t p = 0; p < count; ++p)
      if (active[p] != 0) active[p] = GiveBack(packets[p], active[p], places);
  }

 private:
  // The order in which fields are scattered and gathered by fours.
  static_assert(offsetof(StreamRay, shift) == 12 && offsetof(StreamRay, t) == 24);
  static_assert(offsetof(StreamRay, origin) == 32 && offsetof(StreamRay, shear_y) == 48);
  static_assert(offsetof(StreamRay, best_t) == 56 && offsetof(StreamRay, last_axis) == 60);
  static_assert(offsetof(StreamHit, voxel) == 12 && offsetof(StreamHit, local) == 16);
  static_assert(offsetof(StreamHit, source) == 28);

  /// The rays of one vector from `first` on that go down along the axis, as bits.
  static uint32_t Down(const RayPacket& packet, uint32_t first, uint32_t axis) {
    return L::Bits(L::Less(Divisor<L>(L::Load(packet.direction[axis] + first)), L::Set(0.0f)));
  }

  /// Adds the packet's rays that `active` names to the counts of their octants.
  static void CountOctants(const RayPacket& packet, uint64_t active, uint32_t (&counts)[8]) {
    for (uint32_t first = 0; first < RayPacket::kRays; first += L::kLanes) {
      const uint32_t lanes = static_cast<uint32_t>(active >> first) & L::kAllLanes;
      if (lanes == 0) continue;
      const uint32_t down[3] = {Down(packet, first, 0), Down(packet, first, 1), Down(packet, first, 2)};
      for (uint32_t octant = 0; octant < 8; ++octant) {
        uint32_t of_octant = lanes;
        for (uint32_t a = 0; a < 3; ++a) of_octant &= (octant >> a & 1) != 0 ? down[a] : ~down[a];
        counts[octant] += static_cast<uint32_t>(std::popcount(of_octant));
      }
    }
  }

  /// Addresses of as many rays of the stream as there are lanes.
  struct Places {
    float *ray[L::kLanes], *hit[L::kLanes];
  };

  /// The rays at `place(lane)`, called in order for each lane that `lanes` names; a dummy for other lanes.
  template <class PlaceOf>
  Places PlacesOf(uint32_t lanes, const PlaceOf& place) {
    Places at;
    std::fill_n(at.ray, L::kLanes, no_ray_.floats());
    std::fill_n(at.hit, L::kLanes, no_hit_.floats());
    for (; lanes != 0; lanes &= lanes - 1) {
      const auto lane = static_cast<uint32_t>(std::countr_zero(lanes));
      const uint32_t i = place(lane);
      at.ray[lane] = rays_[i].floats();
      at.hit[lane] = hits_[i].floats();
    }
    return at;
  }

  /// Takes up the rays of packet p that `active` names, each at the next place of its octant. Writes the
  /// places from `places` on; returns one past the last.
  uint32_t* TakeUp(const RayPacket& packet, uint32_t p, uint64_t active, uint32_t (&next)[8],
                   uint32_t* places) {
    using Float = typename L::Float;
    using Int = typename L::Int;
    const float lower[3] = {top_.lower.x, top_.lower.y, top_.lower.z};
    const float upper[3] = {top_.upper.x, top_.upper.y, top_.upper.z};
    for (uint32_t first = 0; first < RayPacket::kRays; first += L::kLanes) {
      const uint32_t lanes = static_cast<uint32_t>(active >> first) & L::kAllLanes;
      if (lanes == 0) continue;
      const RayFrame<L> frame = LoadFrame<L>(packet, first);
      Int octant = L::SetInt(0);
      for (uint32_t a = 0; a < 3; ++a) {
        const auto down = L::Less(frame.reciprocal[a], L::Set(0.0f));
        octant = L::AddInt(octant, L::SelectInt(down, L::SetInt(1u << a), L::SetInt(0)));
      }
      alignas(64) uint32_t octants[L::kLanes];
      L::StoreInt(octant, octants);
      const Places at = PlacesOf(lanes, [&](uint32_t lane) { return *places++ = next[octants[lane]]++; });

      const RayBest<L> best = LoadBest<L, kAnyHit>(packet, first);
      Float t = L::Load(packet.t + first), t_end = best.t;
      ClipToBox<L>(frame, lower, upper, t, t_end);
      Float x = frame.origin[0], y = frame.origin[1], z = frame.origin[2];
      Rotate<L>(frame, x, y, z);
      const Int last_axis =
          L::SelectInt(frame.z_is_x, L::SetInt(0), L::SelectInt(frame.z_is_y, L::SetInt(1), L::SetInt(2)));
      L::Scatter4(at.ray, 0, frame.reciprocal[0], frame.reciprocal[1], frame.reciprocal[2], frame.shift[0]);
      L::Scatter4(at.ray, 4, frame.shift[1], frame.shift[2], t, t_end);
      L::Scatter4(at.ray, 8, x, y, z, frame.shear_x);
      L::Scatter4(at.ray, 12, frame.shear_y, frame.scale_z, best.t, L::AsFloat(last_axis));
      const Int source = L::AddInt(L::SetInt(p * RayPacket::kRays + first), L::Iota());
      if (kAnyHit)
        L::Scatter4(at.hit, 0, L::AsFloat(best.triangle), t, t, t);
      else
        L::Scatter4(at.hit, 0, L::AsFloat(best.triangle), best.b1, best.b2, L::AsFloat(best.voxel));
      L::Scatter4(at.hit, 4, kAnyHit ? t : L::AsFloat(best.local), L::Set(kInfinity), t, L::AsFloat(source));
    }
    return places;
  }

  /// Writes the results of the packet's rays that `active` names; their places are read from `places` on.
  /// Returns the rays that are yet to be traced, as bits.
  uint64_t GiveBack(RayPacket& packet, uint64_t active, const uint32_t*& places) {
    using Float = typename L::Float;
    using Int = typename L::Int;
    uint64_t left = 0;
    for (uint32_t first = 0; first < RayPacket::kRays; first += L::kLanes) {
      const uint32_t lanes = static_cast<uint32_t>(active >> first) & L::kAllLanes;
      if (lanes == 0) continue;
      const Places at = PlacesOf(lanes, [&](uint32_t) { return *places++; });
      Float triangle, b1, b2, voxel, local, t_stop, stops_at, source, shear_y, scale_z, best_t, last_axis;
      L::Gather4(at.hit, 0, triangle, b1, b2, voxel);
      L::Gather4(at.hit, 4, local, t_stop, stops_at, source);
      L::Gather4(at.ray, 12, shear_y, scale_z, best_t, last_axis);
      const auto mine = L::FromBits(lanes);
      const auto put = [&](Float value, float* to) {
        L::Store(L::Select(mine, value, L::Load(to + first)), to + first);
      };
      const auto put_int = [&](Int value, uint32_t* to) {
        L::StoreInt(L::SelectInt(mine, value, L::LoadInt(to + first)), to + first);
      };
      // A nearer hit may have been found since.
      const auto stops = L::And(L::Less(t_stop, L::Set(kInfinity)), L::LessEqual(t_stop, best_t));
      const auto incoherent =
          L::And(L::And(stops, mine), L::HasBits(L::AsInt(source), StreamHit::kIncoherent));
      left |= uint64_t{L::Bits(incoherent)} << first;
      put_int(L::SelectInt(L::AndNot(incoherent, stops), L::AsInt(stops_at), L::SetInt(kNoVoxel)),
              packet.waits_for);
      put(L::Select(stops, t_stop, L::Load(packet.t + first)), packet.t);
      put_int(L::SelectInt(stops, L::AsInt(stops_at), L::LoadInt(packet.chain + first)), packet.chain);
      put(best_t, packet.hit_t);
      put_int(L::AsInt(triangle), packet.triangle);
      if (kAnyHit) continue;
      put(b1, packet.b1);
      put(b2, packet.b2);
      put_int(L::AsInt(voxel), packet.voxel);
      put_int(L::AsInt(local), packet.local);
    }
    return left;
  }

  const TopTree& top_;
  StreamRay* rays_;
  StreamHit* hits_;
  // Dummies that lanes without a ray read and write.
  StreamRay no_ray_{};
  StreamHit no_hit_{};
};

}  // namespace quarry

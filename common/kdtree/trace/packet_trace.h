#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/trace/packet_rays.h"

// Coherent packets through the two-level tree: 64 rays share a node. A way of packets has
//   NodesOf(tree), of a TopTree or a VoxelGeometry;
//   Cells, lanes that may be triangles as well;
//   Traverse(nodes, p, t, t_end, alive, statistics, visit), which visits all leaves along the rays of `p`
//   that are `alive`, from `t` to `t_end`, each once for all rays that pass it at that time: bool
//   visit(first, count, Mask active[], const Float t_enter[], const Float t_exit[]) may lower t_end, and take
//   rays out of `active` and `alive`; false: nothing has changed.
// The rays of one run have the signs of their directions in common.

namespace quarry {

/// Ends the rays that the occluder of earlier rays ends. Returns whether no ray is left.
template <class L, bool kSharedOrigin, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline bool EndAtOccluder(const Finder& finder, PacketRays<L>& p, Statistics& statistics) {
  const auto [voxel, reference] = p.occluder;
  if (voxel == kNoVoxel) return false;
  const auto* geometry = finder.Find(voxel);
  if (!geometry) return false;
  typename L::Mask active[PacketRays<L>::kGroups];
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) active[g] = p.alive[g];
  TestTriangles<L, true, kSharedOrigin>(*geometry, voxel, reference, reference + 1, p, active, p.t_end,
                                        p.alive, statistics);
  return JoinBits<L>(p.alive) == 0;
}

/// The first voxel of a leaf's chain with which any of the rays `active` continues. `first`: the chain's
/// first voxel.
template <class L>
QUARRY_HOST_DEVICE inline uint32_t FirstInChain(const TopTree& top, const PacketRays<L>& p, uint32_t first,
                                                const typename L::Mask* active) {
  if (top.chain_end[first] == first + 1) return first;
  uint32_t least = kNoVoxel;
  for (uint32_t g = 0; g < PacketRays<L>::kGroups; ++g) {
    alignas(64) uint32_t chain[L::kLanes];
    L::StoreInt(p.chain[g], chain);
    for (uint32_t left = L::Bits(active[g]); left != 0; left &= left - 1)
      least = std::min(least, top.GoOnInChain(first, chain[std::countr_zero(left)]));
  }
  return least;
}

/// Traces the packet's rays that are alive through the two-level tree.
template <class PacketWay, class L, bool kAnyHit, bool kSharedOrigin, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline void TraceRun(const TopTree& top, const Finder& finder, PacketRays<L>& p,
                                        Statistics& statistics) {
  using Float = typename L::Float;
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  if (kAnyHit && EndAtOccluder<L, kSharedOrigin>(finder, p, statistics)) return;
  const PacketWay way(p);

  // Tests the triangles of a resident voxel along the rays `inside`, from t_enter to t_exit; hits beyond the
  // cell count too.
  const auto trace_voxel = [&](const auto& geometry, uint32_t voxel, const Mask* inside, const Float* t_enter,
                               const Float* t_exit) {
    Float t[kGroups], t_end[kGroups];
    Mask alive[kGroups];
    for (uint32_t g = 0; g < kGroups; ++g) {
      t[g] = t_enter[g];
      t_end[g] = L::Min(t_exit[g], p.best[g].t);
      alive[g] = inside[g];
    }
    const auto visit = [&](uint32_t first, uint32_t count, Mask* active, const Float*, const Float*) {
      ++p.visits;
      p.visitors += CountAll<L>(active);
      if (p.diverges()) {
        for (uint32_t g = 0; g < kGroups; ++g) alive[g] = active[g] = L::NoLanes();
        return true;
      }
      using Cells = typename PacketWay::Cells;
      if (FewInGroups<L, Cells>(active, count))
        return TestTrianglesRayByRay<Cells, L, kAnyHit>(geometry, voxel, first, first + count, p, active,
                                                        t_end, alive, statistics);
      return TestTriangles<L, kAnyHit, kSharedOrigin>(geometry, voxel, first, first + count, p, active, t_end,
                                                      alive, statistics);
    };
    way.Traverse(PacketWay::NodesOf(geometry), p, t, t_end, alive, statistics, visit);
  };

  const auto visit = [&](uint32_t first, uint32_t, Mask* active, const Float* t_enter, const Float* t_exit) {
    const uint32_t end = top.chain_end[first];
    for (uint32_t voxel = FirstInChain(top, p, first, active); voxel < end; ++voxel) {
      Mask inside[kGroups], any = L::NoLanes();
      const VoxelBounds& bounds = top.bounds[voxel];
      for (uint32_t g = 0; g < kGroups; ++g) {
        // A ray that has waited continues with the voxel that it waited for, if this chain has it
        // (GoOnInChain).
        const Mask passed =
            L::And(L::LessInt(p.chain[g], L::SetInt(end)), L::LessInt(L::SetInt(voxel), p.chain[g]));
        inside[g] = L::And(
            L::AndNot(passed, active[g]),
            Meets<L>(p.frame[g], bounds.lower, bounds.upper, t_enter[g], L::Min(t_exit[g], p.best[g].t)));
        any = L::Or(any, inside[g]);
      }
      if (L::None(any)) continue;
      statistics.Voxel(CountAll<L>(inside));
      if (const auto* geometry = finder.Find(voxel)) {
        trace_voxel(*geometry, voxel, inside, t_enter, t_exit);
        if (p.diverges()) {
          p.diverged |= JoinBits<L>(p.alive);
          for (uint32_t g = 0; g < kGroups; ++g) p.alive[g] = active[g] = L::NoLanes();
          return true;
        }
        for (uint32_t g = 0; g < kGroups; ++g) {
          active[g] = L::And(active[g], p.alive[g]);
          if (kAnyHit)
            p.t_wait[g] = L::Select(L::AndNot(p.alive[g], inside[g]), L::Set(kInfinity), p.t_wait[g]);
        }
        continue;
      }
      // The rays need no leaf beyond this one for now; nearer leaves may still follow.
      for (uint32_t g = 0; g < kGroups; ++g) {
        p.waits_for[g] = L::SelectInt(inside[g], L::SetInt(voxel), p.waits_for[g]);
        p.t_wait[g] = L::Select(inside[g], t_enter[g], p.t_wait[g]);
        active[g] = L::AndNot(inside[g], active[g]);
      }
      if (JoinBits<L>(active) == 0) break;
    }
    for (uint32_t g = 0; g < kGroups; ++g) p.t_end[g] = L::Min(p.t_end[g], L::Min(p.best[g].t, p.t_wait[g]));
    return true;
  };
  way.Traverse(PacketWay::NodesOf(top), p, p.t, p.t_end, p.alive, statistics, visit);
}

/// The rays of a packet that are yet to be traced, a bit each.
struct Untraced {
  uint64_t incoherent;  ///< of runs shorter than kLeastRun
  uint64_t diverged;    ///< of runs that diverged on their way
};

/// Traces the rays of `rays` that `active` names (bit i: ray i), in runs that have the signs and the largest
/// axis of their directions in common. Unless `all` are wanted, skips runs of fewer than kLeastRun rays and
/// stops runs that diverge; returns the rays that are yet to be traced. `occluder`: kept from packet to
/// packet. The packet's fields afterwards: see TraceFunction. Thread-safe with an occluder for each thread.
/// Source: Wald & Slusallek 2001, section 5 (packets). Runs and divergence are additions.
template <class PacketWay, class L, bool kAnyHit, class Finder, class Statistics>
QUARRY_HOST_DEVICE inline Untraced TracePacket(const TopTree& top, const Finder& finder, RayPacket& rays,
                                               uint64_t active, bool all, Occluder& occluder,
                                               Statistics& statistics) {
  using Mask = typename L::Mask;
  constexpr uint32_t kGroups = PacketRays<L>::kGroups;
  const uint32_t least_run = all ? 1 : kLeastRun;
  PacketRays<L> p;
  p.diverged = 0;
  p.occluder = occluder;
  p.rays = &rays;
  p.bounded = rays.bounded & active;
  Mask alive[kGroups], backward[3][kGroups], z_is_x[kGroups], z_is_y[kGroups], elsewhere[kGroups];
  const float lower[3] = {top.lower.x, top.lower.y, top.lower.z};
  const float upper[3] = {top.upper.x, top.upper.y, top.upper.z};
  const auto first = static_cast<uint32_t>(std::countr_zero(active));
  for (int a = 0; a < 3; ++a) p.shared_origin[a] = rays.origin[a][first];
  for (uint32_t g = 0; g < kGroups; ++g) {
    const uint32_t at = g * L::kLanes;
    p.frame[g] = LoadFrame<L>(rays, at);
    p.chain[g] = L::LoadInt(rays.chain + at);
    p.waits_for[g] = L::SetInt(kNoVoxel);
    p.t[g] = L::Load(rays.t + at);
    p.t_wait[g] = L::Set(kInfinity);
    p.best[g] = LoadBest<L, kAnyHit>(rays, at);
    p.t_end[g] = p.best[g].t;
    ClipToBox<L>(p.frame[g], lower, upper, p.t[g], p.t_end[g]);
    alive[g] =
        L::And(L::FromBits(static_cast<uint32_t>(active >> at) & L::kAllLanes), L::Less(p.t[g], p.t_end[g]));
    elsewhere[g] = L::NoLanes();
    for (int a = 0; a < 3; ++a) {
      backward[a][g] = L::Less(p.frame[g].reciprocal[a], L::Set(0.0f));
      elsewhere[g] = L::Or(elsewhere[g],
                           L::AndNot(L::Equal(p.frame[g].origin[a], L::Set(p.shared_origin[a])), alive[g]));
    }
    z_is_x[g] = p.frame[g].z_is_x;
    z_is_y[g] = p.frame[g].z_is_y;
  }
  const bool shared_origin = JoinBits<L>(elsewhere) == 0;
  const bool nearest = !kAnyHit && !shared_origin;
  p.least_visits = nearest ? kLeastVisitsOfNearest : kLeastVisits;
  p.least_visitors = all ? 0 : nearest ? kLeastVisitorsOfNearest : kLeastVisitors;
  const uint64_t negative[3] = {JoinBits<L>(backward[0]), JoinBits<L>(backward[1]), JoinBits<L>(backward[2])};
  const uint64_t x_largest = JoinBits<L>(z_is_x), y_largest = JoinBits<L>(z_is_y);
  uint64_t incoherent = 0;
  const uint64_t all_alive = JoinBits<L>(alive);
  for (uint64_t left = all_alive; left != 0;) {
    const int leader = std::countr_zero(left);
    uint64_t run = left;
    const auto alike = [&](uint64_t bits) { return bits >> leader & 1 ? bits : ~bits; };
    for (int a = 0; a < 3; ++a) {
      run &= alike(negative[a]);
      p.far_side[a] = negative[a] >> leader & 1 ? 0 : 1;
    }
    run &= alike(x_largest) & alike(y_largest);
    left &= ~run;
    if (static_cast<uint32_t>(std::popcount(run)) < least_run) {
      incoherent |= run;
      continue;
    }
    const uint32_t largest = x_largest >> leader & 1 ? 0 : y_largest >> leader & 1 ? 1 : 2;
    for (uint32_t a = 0; a < 3; ++a) p.axes[a] = (largest + 1 + a) % 3;
    for (uint32_t g = 0; g < kGroups; ++g)
      p.alive[g] = L::FromBits(static_cast<uint32_t>(run >> (g * L::kLanes)) & L::kAllLanes);
    p.visits = p.visitors = 0;
    statistics.Ray(static_cast<uint32_t>(std::popcount(run)));
    if (shared_origin)
      TraceRun<PacketWay, L, kAnyHit, true>(top, finder, p, statistics);
    else
      TraceRun<PacketWay, L, kAnyHit, false>(top, finder, p, statistics);
  }
  if (all_alive != 0 && incoherent == all_alive) return {active, 0};
  for (uint32_t g = 0; g < kGroups; ++g) {
    const uint32_t at = g * L::kLanes;
    const Mask mine = L::FromBits(static_cast<uint32_t>((active & ~incoherent) >> at) & L::kAllLanes);
    const Mask diverged = L::FromBits(static_cast<uint32_t>(p.diverged >> at) & L::kAllLanes);
    StoreBest<L, kAnyHit>(p.best[g], rays, at);  // rays that were not traced keep their values
    // A nearer hit may have been found since. Diverged rays have not visited all leaves before the voxel that
    // they wait for: they start again from their t.
    const Mask waits = L::AndNot(
        diverged, L::And(L::Less(p.t_wait[g], L::Set(kInfinity)), L::LessEqual(p.t_wait[g], p.best[g].t)));
    const auto voxel = L::SelectInt(waits, p.waits_for[g], L::SetInt(kNoVoxel));
    const auto t = L::Select(waits, p.t_wait[g], p.t[g]);
    L::Store(L::Select(mine, t, L::Load(rays.t + at)), rays.t + at);
    L::StoreInt(L::SelectInt(waits, voxel, p.chain[g]), rays.chain + at);
    L::StoreInt(L::SelectInt(mine, voxel, L::LoadInt(rays.waits_for + at)), rays.waits_for + at);
  }
  occluder = p.occluder;
  return {incoherent, p.diverged};
}

}  // namespace quarry

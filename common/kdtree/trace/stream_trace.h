#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <numeric>

#include "common/kdtree/trace/kernel_parts.h"
#include "common/kdtree/trace/stream_memory.h"
#include "common/kdtree/trace/stream_rays.h"
#include "common/kdtree/trace/triangle_block.h"
#include "common/kdtree/trace/triangle_pairs.h"
#include "common/kdtree/wide_node.h"

// Streams: thousands of rays of one octant go through wide nodes together. A node is loaded once for all rays
// that come to it; each ray is tested against vectors of its cells. A leaf's triangles are gathered once for
// all its rays. Kd cells do not overlap: all rays of an octant pass a node's cells in an order that it holds.
//
// The lists of the nodes above the present one are a stack, the only one in any kernel: one for all rays of a
// stream. A ray has no stack, and is suspended and resumed by itself, as in all kernels. Streams suit
// processors with large caches; CUDA uses kernels where each lane is a ray.
// Source: Tsakok 2009, "Faster Incoherent Rays: Multi-BVH Ray Stream Tracing". Kd cells and suspension are
// additions.

namespace quarry {

/// Limit of packets in a stream. Trades loads shared by more rays against rays that fall out of the caches
/// (tests/bench/history/kdtree.md, 2026-11-24).
inline constexpr uint32_t kStreamPackets = 1024;
/// Least number of rays that visit a voxel together; fewer rays leave the stream and are traced singly
/// (tests/bench/history/kdtree.md, 2026-11-24).
inline constexpr uint32_t kLeastCoherent = 12;
/// Least mean number of rays per visited leaf, times 4; below it all rays leave the stream. The mean counts
/// after kFirstVisits visits (tests/bench/history/kdtree.md, 2026-11-24).
inline constexpr uint32_t kFirstVisits = 64, kLeastVisitorsBy4 = 5;

/// The kernel. One object traces one stream. `L`: lanes that are rays; `W`: lanes that are a node's cells, or
/// a leaf's triangles.
template <class L, class W, bool kAnyHit, class Finder, class Statistics>
class StreamTracer {
 public:
  using Index = typename Finder::Index;
  using Geometry = VoxelGeometryOf<Index>;

  /// Requires: room in `memory` for the rays.
  StreamTracer(const TopTree& top, const Finder& finder, Statistics& statistics, StreamMemory& memory)
      : top_(top),
        finder_(finder),
        statistics_(statistics),
        rays_(memory.rays.get()),
        hits_(memory.hits.get()),
        taken_(top, memory),
        ids_(memory.ids.get()),
        masks_(memory.masks.get()) {}

  /// Traces the rays that `active` names, and takes them out of it. Rays stay in `active`, to be traced on
  /// from the voxel that they have come to, where fewer than `least_coherent` rays come to the voxel
  /// together, or where leaves have few visitors. With a `least_coherent` of 0 no ray stays.
  void Run(RayPacket* packets, uint64_t* active, uint32_t count, uint32_t least_coherent) {
    packets_ = packets;
    least_coherent_ = least_coherent;
    bounded_ = 0;
    for (uint32_t p = 0; p < count; ++p) bounded_ |= packets[p].bounded & active[p];
    uint32_t end[8];
    uint32_t* const places = ids_;
    const uint32_t n = taken_.TakeUp(packets, active, count, end, places);
    statistics_.Ray(n);
    ids_ += n + kSlack;
    for (octant_ = 0; octant_ < 8; ++octant_) RunOctant(octant_ == 0 ? 0 : end[octant_ - 1], end[octant_]);
    taken_.GiveBack(packets, active, count, places);
  }

 private:
  static constexpr uint32_t kSlack = StreamMemory::kSlack;
  static constexpr uint32_t kFewPairs = 3;  ///< so few pairs of ray and triangle are tested ray by ray
  static constexpr uint32_t kAhead = 16;    ///< rays: how far ahead a ray is asked for

  static_assert(kStreamPackets * RayPacket::kRays <= StreamHit::kIncoherent);

  /// Traces the present octant's rays [begin, end).
  void RunOctant(uint32_t begin, uint32_t end) {
    if (begin == end) return;
    for (uint32_t a = 0; a < 3; ++a) {
      const bool forward = (octant_ >> a & 1) == 0;
      near_face_[a] = WideNode::Face(a, !forward);
      far_face_[a] = WideNode::Face(a, forward);
    }
    uint32_t* const all = ids_;
    std::iota(all, all + (end - begin), begin);
    ids_ += end - begin + kSlack;
    Walk(TopLeaves{*this}, top_.wide, top_.wide[0], all, end - begin);
    ids_ = all;
  }

  /// Writes to masks[i] the node's cells that ray ids[i] passes, as bits. Returns the cells that any ray
  /// passes.
  uint32_t Look(const WideNode& node, const uint32_t* ids, uint32_t n, uint8_t* masks) {
    using Float = typename W::Float;
    constexpr uint32_t kVectors = WideNode::kChildren / W::kLanes;
    Float near_plane[3][kVectors], far_plane[3][kVectors];
    for (uint32_t a = 0; a < 3; ++a)
      for (uint32_t v = 0; v < kVectors; ++v) {
        near_plane[a][v] = W::LoadU(node.bounds + near_face_[a] + v * W::kLanes);
        far_plane[a][v] = W::LoadU(node.bounds + far_face_[a] + v * W::kLanes);
      }
    uint32_t any = 0;
    for (uint32_t i = 0; i < n; ++i) {
      statistics_.Node(1, 1);
      W::Prefetch(&rays_[ids[std::min(i + kAhead, n - 1)]], sizeof(StreamRay));
      const StreamRay& ray = rays_[ids[i]];
      uint32_t bits = 0;
#pragma GCC unroll 8
      for (uint32_t v = 0; v < kVectors; ++v) {
        Float enter = W::Set(ray.t), exit = W::Set(ray.t_end);
#pragma GCC unroll 3
        for (uint32_t a = 0; a < 3; ++a) {
          const Float reciprocal = W::Set(ray.reciprocal[a]), shift = W::Set(ray.shift[a]);
          enter = W::Max(enter, W::Fma(near_plane[a][v], reciprocal, shift));
          exit = W::Min(exit, W::Fma(far_plane[a][v], reciprocal, shift));
        }
        bits |= W::Bits(W::Less(enter, exit)) << (v * W::kLanes);
      }
      masks[i] = static_cast<uint8_t>(bits);
      any |= bits;
    }
    return any;
  }

  /// Visits all leaves below `node` that the rays `ids` come to, nearest first.
  template <class Leaves>
  void Walk(const Leaves& leaves, const WideNode* nodes, const WideNode& node, const uint32_t* ids,
            uint32_t n) {
    uint8_t* const masks = masks_;
    leaves.Expect(node);
    const uint32_t any = Look(node, ids, n, masks);
    masks_ += n + kSlack;
    leaves.Await(node, any);
    for (uint32_t left = any; left != 0; left &= left - 1) {
      const auto c = static_cast<uint32_t>(std::countr_zero(left));
      if (node.count[c] == WideNode::kInner) W::Prefetch(nodes + node.child[c], sizeof(WideNode));
    }
    const bool flip = octant_ >= 4;
    const uint32_t order = node.Order(flip ? 7 - octant_ : octant_);
    for (uint32_t k = 0; k < WideNode::kChildren; ++k) {
      const uint32_t c = order >> (3 * (flip ? 7 - k : k)) & 7;
      if ((any >> c & 1) == 0) continue;
      uint32_t* const list = ids_;
      const uint32_t m = L::Choose(masks, c, ids, n, list);
      ids_ += m + kSlack;
      if (node.count[c] == WideNode::kInner)
        Walk(leaves, nodes, nodes[node.child[c]], list, m);
      else
        leaves.Visit(node, c, list, m);
      ids_ = list;
    }
    masks_ = masks;
  }

  /// The t at which the ray enters the node's cell c.
  float Enter(const StreamRay& ray, const WideNode& node, uint32_t c) const {
    float enter = ray.t;
    for (uint32_t a = 0; a < 3; ++a)
      enter = ScalarLane::Max(
          enter, ScalarLane::Fma(node.bounds[near_face_[a] + c], ray.reciprocal[a], ray.shift[a]));
    return enter;
  }

  /// Leaves of the top-level tree.
  struct TopLeaves {
    StreamTracer& tracer;
    void Expect(const WideNode&) const {}
    void Await(const WideNode&, uint32_t) const {}
    void Visit(const WideNode& node, uint32_t c, uint32_t* ids, uint32_t n) const {
      tracer.VisitVoxels(node, c, ids, n);
    }
  };

  /// Puts first the rays of `ids` that enter the node's cell c before their ends; returns their number.
  uint32_t KeepComing(const WideNode& node, uint32_t c, uint32_t* ids, uint32_t n) const {
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; ++i) {
      // Some rays have found a nearer hit meanwhile.
      const StreamRay& ray = rays_[ids[i]];
      ids[m] = ids[i];
      m += Enter(ray, node, c) < ray.t_end ? 1 : 0;
    }
    return m;
  }

  void VisitVoxels(const WideNode& node, uint32_t c, uint32_t* ids, uint32_t n) {
    const uint32_t first = node.child[c], end = top_.chain_end[first];
    n = KeepComing(node, c, ids, n);
    if (end == first + 1) return VisitVoxel(node, c, first, ids, n);
    uint32_t begin = end;
    for (uint32_t i = 0; i < n; ++i) begin = std::min(begin, GoesOnAt(ids[i], first));
    uint32_t* const list = ids_;
    for (uint32_t voxel = begin; n != 0; ++voxel) {
      uint32_t m = 0;
      for (uint32_t i = 0; i < n; ++i) {
        list[m] = ids[i];
        m += MeetsInChain(ids[i], node, c, first, voxel) ? 1 : 0;
      }
      ids_ = list + m + kSlack;
      VisitVoxel(node, c, voxel, list, m);
      ids_ = list;
      if (voxel + 1 == end) break;
      if (m != 0) n = KeepComing(node, c, ids, n);
    }
  }

  /// Traces the rays `ids`, which come to `voxel` of the present top-level leaf.
  void VisitVoxel(const WideNode& node, uint32_t c, uint32_t voxel, const uint32_t* ids, uint32_t n) {
    if (n == 0) return;
    // The finder notes each voxel that it is asked for: rays that leave the stream here do not ask.
    const bool incoherent = n < least_coherent_ || (least_coherent_ != 0 && scattered());
    const Geometry* geometry = incoherent ? nullptr : finder_.Find(voxel);
    if (!geometry) {
      for (uint32_t i = 0; i < n; ++i) Stop(ids[i], Enter(rays_[ids[i]], node, c), voxel, incoherent);
      return;
    }
    statistics_.Voxel(n);
    Walk(VoxelLeaves{*this, *geometry, voxel}, geometry->wide, geometry->wide[0], ids, n);
  }

  /// Whether leaves have few visitors.
  bool scattered() const { return visits_ >= kFirstVisits && visitors_ * 4 < visits_ * kLeastVisitorsBy4; }

  // Where a ray comes from.
  uint32_t SourceOf(uint32_t id) const { return hits_[id].source & ~StreamHit::kIncoherent; }
  RayPacket& PacketOf(uint32_t id) const { return packets_[SourceOf(id) / RayPacket::kRays]; }
  uint32_t LaneOf(uint32_t id) const { return SourceOf(id) % RayPacket::kRays; }

  /// Whether a hit of the ray comes before its lower bound, or is the bound.
  bool Passed(uint32_t id, float t, uint32_t triangle) const {
    const RayBound<ScalarLane> bound = BoundOf(PacketOf(id), LaneOf(id));
    return !Follows<ScalarLane>(t, triangle, bound.t, bound.triangle);
  }

  /// The voxel with which a ray continues in the chain that begins with `first`.
  uint32_t GoesOnAt(uint32_t id, uint32_t first) const {
    return top_.GoOnInChain(first, PacketOf(id).chain[LaneOf(id)]);
  }

  /// Whether a ray comes to a voxel of the chain that begins with `first`, before its end.
  bool MeetsInChain(uint32_t id, const WideNode& node, uint32_t c, uint32_t first, uint32_t voxel) const {
    if (GoesOnAt(id, first) > voxel) return false;
    const StreamRay& ray = rays_[id];
    float enter = Enter(ray, node, c), exit = ray.t_end;
    for (uint32_t a = 0; a < 3; ++a)
      exit = ScalarLane::Min(exit,
                             ScalarLane::Fma(node.bounds[far_face_[a] + c], ray.reciprocal[a], ray.shift[a]));
    if (!(enter < exit)) return false;
    const auto t_of = [&](float plane, int a) {
      return ScalarLane::Fma(plane, ray.reciprocal[a], ray.shift[a]);
    };
    const VoxelBounds& bounds = top_.bounds[voxel];
    ClipToSlabs<ScalarLane>(bounds.lower, bounds.upper, t_of, enter, exit);
    return enter <= exit;
  }

  /// Stops the ray at `voxel`, which it enters at `t`. `incoherent`: because few rays come there.
  void Stop(uint32_t id, float t, uint32_t voxel, bool incoherent) {
    StreamHit& hit = hits_[id];
    hit.t_stop = t;
    hit.stops_at = voxel;
    hit.source = (hit.source & ~StreamHit::kIncoherent) | (incoherent ? StreamHit::kIncoherent : 0);
    rays_[id].t_end = ScalarLane::Min(rays_[id].t_end, t);
  }

  /// Leaves of a voxel's tree.
  struct VoxelLeaves {
    StreamTracer& tracer;
    const Geometry& voxel;
    uint32_t voxel_id;

    /// Asks for the references of the node's leaves, before it is known which of them rays come to.
    void Expect(const WideNode& node) const {
      for (uint32_t c = 0; c < WideNode::kChildren; ++c)
        if (node.count[c] != WideNode::kInner) W::Prefetch(voxel.references + node.child[c], 1);
    }
    /// Asks for corners, then vertices, of the leaves' triangles. Neighbours lie side by side: some are
    /// enough.
    void Await(const WideNode& node, uint32_t cells) const {
      constexpr uint32_t kMost = 16;
      uint32_t leaves = 0;
      for (; cells != 0; cells &= cells - 1) {
        const auto c = static_cast<uint32_t>(std::countr_zero(cells));
        if (node.count[c] == WideNode::kInner) continue;
        leaves |= 1u << c;
      }
      for (uint32_t left = leaves; left != 0; left &= left - 1) {
        const auto c = static_cast<uint32_t>(std::countr_zero(left));
        const Index* local = voxel.references + node.child[c];
        for (const uint32_t i : {0u, node.count[c] / 2u, node.count[c] - 1u})
          W::Prefetch(voxel.corners + size_t{3} * local[i], 1);
      }
      for (uint32_t left = leaves; left != 0; left &= left - 1) {
        const auto c = static_cast<uint32_t>(std::countr_zero(left));
        const Index* local = voxel.references + node.child[c];
        for (uint32_t i = 0; i < node.count[c] && i < kMost; i += 2)
          W::Prefetch(voxel.vertices + voxel.corners[size_t{3} * local[i]], 1);
      }
    }
    void Visit(const WideNode& node, uint32_t c, uint32_t* ids, uint32_t n) const {
      const uint32_t m = tracer.KeepComing(node, c, ids, n);
      tracer.statistics_.Leaf(m);
      if (m == 0) return;
      tracer.visits_ += 1;
      tracer.visitors_ += m;
      const uint32_t count = node.count[c];
      for (uint32_t done = 0; done < count; done += TriangleBlock<W>::kMost)
        tracer.TestTriangles(voxel, voxel_id, voxel.references + node.child[c] + done,
                             std::min(count - done, TriangleBlock<W>::kMost), ids, m);
    }
  };

  void TestTriangles(const Geometry& voxel, uint32_t voxel_id, const Index* references, uint32_t count,
                     const uint32_t* ids, uint32_t n) {
    const TriangleBlock<W> block(voxel, references, count);
    // First the filter, without branches.
    uint32_t* const may = ids_;
    uint32_t* const may_ids = may + n + kSlack;
    uint32_t m = 0;
    for (uint32_t i = 0; i < n; ++i) {
      const uint32_t bits = block.MayHit(BlockRayOf<W>(rays_[ids[i]]), statistics_);
      W::Prefetch(voxel.triangle_ids + references[bits != 0 ? std::countr_zero(bits) : 0], 1);
      may_ids[m] = ids[i];
      may[m] = bits;
      m += bits != 0 ? 1 : 0;
    }
    const auto keep = [&](uint32_t id, uint32_t local, float t, float b1, float b2) {
      if (bounded_ != 0 && Passed(id, t, voxel.triangle_ids[local])) [[unlikely]]
        return;
      if (MayPass<kAnyHit>(voxel, local) &&
          !Counts<kAnyHit>(voxel, voxel_id, local, t, b1, b2, PacketOf(id), LaneOf(id)))
        return;
      Keep(id, {true, t, b1, b2}, voxel.triangle_ids[local], voxel_id, local);
    };
    // Then the first triangle that each ray may hit, as many rays at a time as lanes; then the next.
    while (m > kFewPairs) {
      uint32_t i = 0;
      for (; i + W::kLanes < m; i += L::kLanes)
        TestPairs<L>(rays_, voxel, references, may_ids + i, may + i, std::min(m - i, L::kLanes), statistics_,
                     keep);
      if (i < m) TestPairs<W>(rays_, voxel, references, may_ids + i, may + i, m - i, statistics_, keep);
      uint32_t left = 0;
      for (i = 0; i < m; ++i) {
        const uint32_t rest = may[i] & (may[i] - 1);
        may_ids[left] = may_ids[i];
        may[left] = rest;
        left += rest != 0 ? 1 : 0;
      }
      m = left;
    }
    for (uint32_t i = 0; i < m; ++i)
      block.ForEachHit(
          BlockRayOf<W>(rays_[may_ids[i]]), may[i], rays_[may_ids[i]].best_t, statistics_,
          [&](uint32_t r, float t, float b1, float b2) { keep(may_ids[i], references[r], t, b1, b2); });
  }

  void Keep(uint32_t id, const TriangleHit<ScalarLane>& found, uint32_t triangle, uint32_t voxel,
            uint32_t local) {
    StreamRay& ray = rays_[id];
    StreamHit& hit = hits_[id];
    // The order of Precedes. The old triangle's id is read only at equal t: it may lie outside the caches.
    if (found.t > ray.best_t || (found.t == ray.best_t && triangle >= hit.triangle)) [[unlikely]]
      return;
    ray.best_t = found.t;
    hit.triangle = triangle;
    if (kAnyHit) {
      ray.t_end = -kInfinity;
      hit.t_stop = kInfinity;
      return;
    }
    ray.t_end = ScalarLane::Min(ray.t_end, found.t);
    hit.b1 = found.b1;
    hit.b2 = found.b2;
    hit.voxel = voxel;
    hit.local = local;
  }

  const TopTree& top_;
  const Finder& finder_;
  Statistics& statistics_;
  RayPacket* packets_ = nullptr;
  StreamRay* rays_;
  StreamHit* hits_;
  uint32_t least_coherent_ = 0;
  uint64_t bounded_ = 0;                ///< 0: no ray has a lower bound
  uint64_t visits_ = 0, visitors_ = 0;  ///< visits of leaves in voxels; rays summed over these visits
  uint32_t octant_ = 0, near_face_[3], far_face_[3];
  StreamRays<L, kAnyHit> taken_;
  // Free memory behind the lists in use.
  uint32_t* ids_;
  uint8_t* masks_;
};

}  // namespace quarry

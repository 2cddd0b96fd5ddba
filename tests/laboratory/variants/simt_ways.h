#pragma once

#include <bit>
#include <cstdint>

#include "tests/laboratory/variants/simt_lanes.h"

// The structures for lanes: the same arithmetic as UniformGrid, KdRestart and KdBacktrack.

namespace quarry::laboratory {

/// UniformGrid for lanes. A cell's coordinates are floats, which hold them exactly.
template <class L>
class SimtGridWay {
 public:
  using Lanes = SimtLanes<L>;
  using Float = typename L::Float;
  using Int = typename L::Int;
  using Mask = typename L::Mask;

  SimtGridWay(const SimtScene& scene, const SimtGrid& grid, Lanes& lanes)
      : scene_(scene), grid_(grid), lanes_(lanes) {}
  const uint32_t* entries() const { return grid_.list; }

  void Begin(uint32_t i, float t) {
    uint32_t at = 0, stride = 1;
    for (uint32_t a = 0; a < 3; ++a) {
      const bool rises = lanes_.reciprocal[a][i] > 0;
      const uint32_t cell = CellAt(i, t, a, rises);
      cell_[a][i] = static_cast<float>(cell);
      side_[a][i] = rises ? 1.0f : 0.0f;
      last_[a][i] = rises ? static_cast<float>(grid_.resolution[a] - 1) : 0.0f;
      step_[a][i] = rises ? 1.0f : -1.0f;
      stride_[a][i] = rises ? stride : ~stride + 1;
      at += cell * stride;
      stride *= grid_.resolution[a];
    }
    index_[i] = at;
  }

  uint32_t Step(uint32_t few) {
    do {
      alignas(64) uint32_t places[L::kLanes];
#pragma GCC unroll 16
      for (uint32_t i = 0; i < L::kLanes; ++i) places[i] = grid_.cells[index_[i]];
      const uint32_t empty = L::Bits(L::EqualInt(L::LoadInt(places), L::SetInt(0)));
      const uint32_t full = lanes_.on & ~empty;
      Float exit;
      Mask is_y, is_z;
      Exit(exit, is_y, is_z);
      const uint32_t moving = lanes_.on & empty;
      lanes_.on = 0;
      if (full != 0) {
        L::Store(L::Select(L::FromBits(full), exit, L::Load(lanes_.t_exit)), lanes_.t_exit);
        lanes_.list |= full;
        for (uint32_t left = full; left != 0; left &= left - 1) {
          const auto i = static_cast<uint32_t>(std::countr_zero(left));
          lanes_.next[i] = places[i] + 1;
          lanes_.end[i] = places[i] + 1 + grid_.list[places[i]];
        }
      }
      if (moving != 0) lanes_.Finish(Move(moving, exit, is_y, is_z));
    } while (static_cast<uint32_t>(std::popcount(lanes_.on)) > few);
    return 0;
  }

  void Up() {}

  uint32_t Leave(uint32_t lanes) {
    const uint32_t hit = lanes & L::Bits(L::Less(L::Load(lanes_.hit_t), L::Load(lanes_.t_exit)));
    Float exit;
    Mask is_y, is_z;
    Exit(exit, is_y, is_z);
    return hit | Move(lanes & ~hit, exit, is_y, is_z);
  }

 private:
  float PlaneT(uint32_t i, uint32_t axis, uint32_t cell) const {
    const float plane = ScalarLane::Fma(static_cast<float>(cell), grid_.size[axis], scene_.lower[axis]);
    return ScalarLane::Fma(plane, lanes_.reciprocal[axis][i], lanes_.shift[axis][i]);
  }

  uint32_t CellAt(uint32_t i, float t, uint32_t a, bool rises) const {
    const uint32_t last = grid_.resolution[a] - 1;
    const float at = (lanes_.origin[a][i] + t * lanes_.direction[a][i] - scene_.lower[a]) / grid_.size[a];
    uint32_t cell = 0;
    if (at > 0) cell = at < static_cast<float>(last) ? static_cast<uint32_t>(at) : last;
    if (rises) {
      while (cell > 0 && PlaneT(i, a, cell) > t) --cell;
      while (cell < last && PlaneT(i, a, cell + 1) <= t) ++cell;
    } else {
      while (cell < last && PlaneT(i, a, cell + 1) > t) ++cell;
      while (cell > 0 && PlaneT(i, a, cell) <= t) --cell;
    }
    return cell;
  }

  /// Where rays leave their cells, and across which axis.
  void Exit(Float& exit, Mask& is_y, Mask& is_z) const {
    Float t[3];
    for (uint32_t a = 0; a < 3; ++a) {
      const Float plane =
          L::Fma(L::Load(cell_[a]) + L::Load(side_[a]), L::Set(grid_.size[a]), L::Set(scene_.lower[a]));
      t[a] = L::Fma(plane, L::Load(lanes_.reciprocal[a]), L::Load(lanes_.shift[a]));
    }
    is_y = L::Less(t[1], t[0]);
    exit = L::Select(is_y, t[1], t[0]);
    is_z = L::Less(t[2], exit);
    exit = L::Select(is_z, t[2], exit);
    is_y = L::AndNot(is_z, is_y);
  }

  /// Moves `lanes` to the next cell. Returns: those whose rays end.
  uint32_t Move(uint32_t lanes, Float exit, Mask is_y, Mask is_z) {
    const auto pick = [&](const float(&v)[3][L::kLanes]) {
      return L::Select(is_z, L::Load(v[2]), L::Select(is_y, L::Load(v[1]), L::Load(v[0])));
    };
    const Mask at_last = L::Equal(pick(cell_), pick(last_));
    const uint32_t goes_on = lanes & L::Bits(L::AndNot(at_last, L::Less(exit, L::Load(lanes_.t_end))));
    const Mask go = L::FromBits(goes_on);
    const Mask goes[3] = {L::AndNot(L::Or(is_y, is_z), go), L::And(go, is_y), L::And(go, is_z)};
    Int index = L::LoadInt(index_);
    for (uint32_t a = 0; a < 3; ++a) {
      const Float cell = L::Load(cell_[a]);
      L::Store(L::Select(goes[a], cell + L::Load(step_[a]), cell), cell_[a]);
      index = L::SelectInt(goes[a], L::AddInt(index, L::LoadInt(stride_[a])), index);
    }
    L::StoreInt(index, index_);
    lanes_.on |= goes_on;
    return lanes & ~goes_on;
  }

  const SimtScene& scene_;
  const SimtGrid& grid_;
  Lanes& lanes_;
  alignas(64) float cell_[3][L::kLanes] = {};
  alignas(64) float side_[3][L::kLanes] = {};  ///< 1 where the ray leaves by the upper plane
  alignas(64) float last_[3][L::kLanes] = {};
  alignas(64) float step_[3][L::kLanes] = {};
  alignas(64) uint32_t stride_[3][L::kLanes] = {};
  alignas(64) uint32_t index_[L::kLanes] = {};
};

/// KdRestart, or with `kUp` KdBacktrack, for lanes.
template <class L, bool kUp>
class SimtKdWay {
 public:
  using Lanes = SimtLanes<L>;
  using Float = typename L::Float;
  using Int = typename L::Int;
  using Mask = typename L::Mask;

  SimtKdWay(const SimtScene&, const SimtTree& tree, Lanes& lanes) : tree_(tree), lanes_(lanes) {}
  const uint32_t* entries() const { return tree_.list; }

  void Begin(uint32_t i, float t) {
    node_[i] = tree_.root;
    t_[i] = t;
    lanes_.t_exit[i] = lanes_.t_end[i];
  }

  uint32_t Step(uint32_t few) {
    Int node = L::LoadInt(node_);
    const Float t = L::Load(t_);
    Float t_exit = L::Load(lanes_.t_exit);
    const Mask begun = L::FromBits(lanes_.on);
    Mask leaf = L::And(begun, L::HasBits(node, kLeafBit));
    Mask on = L::AndNot(leaf, begun);
    while (!L::None(on)) {
      Float words[3], unused;
      Gather(node, words, unused);
      const Int left = L::AsInt(words[1]), right = L::AsInt(words[2]);
      const Mask is_y = L::HasBits(left, TextureNode::kAxisBit),
                 is_z = L::HasBits(right, TextureNode::kAxisBit);
      const Float reciprocal = ByAxis(is_y, is_z, lanes_.reciprocal);
      const Float plane = L::Fma(words[0], reciprocal, ByAxis(is_y, is_z, lanes_.shift));
      const Mask in_near = L::Less(t, plane), rises = L::Less(L::Set(0.0f), reciprocal);
      const Mask takes_right = L::Xor(in_near, rises);
      const Mask crosses = L::And(on, L::And(in_near, L::Less(plane, t_exit)));
      t_exit = L::Select(crosses, plane, t_exit);
      Int child = L::SelectInt(takes_right, right, left);
      child = L::SelectInt(L::Or(L::And(takes_right, is_z), L::AndNot(takes_right, is_y)),
                           L::AddInt(child, L::SetInt(~TextureNode::kAxisBit + 1)), child);
      node = L::SelectInt(on, child, node);
      const Mask arrived = L::And(on, L::HasBits(node, kLeafBit));
      leaf = L::Or(leaf, arrived);
      on = L::AndNot(arrived, on);
      if (L::Count(on) <= few) break;
    }
    L::StoreInt(node, node_);
    L::Store(t_exit, lanes_.t_exit);
    lanes_.on = L::Bits(on);
    uint32_t empty = 0;
    for (uint32_t left = L::Bits(leaf); left != 0; left &= left - 1) {
      const auto i = static_cast<uint32_t>(std::countr_zero(left));
      const uint32_t* words = tree_.nodes[node_[i] & kPlaceBits].words;
      lanes_.next[i] = words[1];
      lanes_.end[i] = words[1] + words[0];
      (words[0] != 0 ? lanes_.list : empty) |= 1u << i;
    }
    return empty;
  }

  /// Climbs one split. Lanes whose ray is still in its box search it again.
  void Up() {
    if constexpr (kUp) {
      const float* at[L::kLanes];
      const auto some = static_cast<uint32_t>(std::countr_zero(lanes_.up));
#pragma GCC unroll 16
      for (uint32_t i = 0; i < L::kLanes; ++i)
        at[i] = tree_.extended[node_[(lanes_.up >> i & 1u) != 0 ? i : some]].lower;
      Float lower[3], upper[3], parent, unused;
      L::Gather4(at, 0, lower[0], lower[1], lower[2], upper[0]);
      L::Gather4(at, 4, upper[1], upper[2], parent, unused);
      const Float t = L::Load(t_);
      Float enter = L::Set(0.0f), exit = L::Load(lanes_.t_end);
      for (int a = 0; a < 3; ++a) {
        const Float reciprocal = L::Load(lanes_.reciprocal[a]), shift = L::Load(lanes_.shift[a]);
        const Float t0 = L::Fma(lower[a], reciprocal, shift), t1 = L::Fma(upper[a], reciprocal, shift);
        enter = L::Max(enter, L::Min(t0, t1));
        exit = L::Min(exit, L::Max(t0, t1));
      }
      const Mask up = L::FromBits(lanes_.up);
      const Mask inside = L::And(up, L::Or(L::EqualInt(L::AsInt(parent), L::SetInt(kNoNode)),
                                           L::And(L::Less(t, exit), L::LessEqual(enter, t))));
      L::Store(L::Select(inside, exit, L::Load(lanes_.t_exit)), lanes_.t_exit);
      L::StoreInt(L::SelectInt(L::AndNot(inside, up), L::AsInt(parent), L::LoadInt(node_)), node_);
      const uint32_t found = L::Bits(inside);
      lanes_.up &= ~found;
      lanes_.on |= found;
    }
  }

  uint32_t Leave(uint32_t lanes) {
    const Float t_exit = L::Load(lanes_.t_exit), t_end = L::Load(lanes_.t_end);
    const Mask ahead = L::AndNot(L::Less(L::Load(lanes_.hit_t), t_exit), L::Less(t_exit, t_end));
    const uint32_t goes_on = lanes & L::Bits(ahead);
    const Mask go = L::FromBits(goes_on);
    L::Store(L::Select(go, t_exit, L::Load(t_)), t_);
    if constexpr (kUp) {
      for (uint32_t left = goes_on; left != 0; left &= left - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(left));
        node_[i] = tree_.nodes[node_[i] & kPlaceBits].words[2];
      }
      lanes_.up |= goes_on;
    } else {
      L::StoreInt(L::SelectInt(go, L::SetInt(tree_.root), L::LoadInt(node_)), node_);
      L::Store(L::Select(go, t_end, t_exit), lanes_.t_exit);
      lanes_.on |= goes_on;
    }
    return lanes & ~goes_on;
  }

 private:
  /// Fetches each lane's node. The array has a word behind its last node.
  void Gather(Int node, Float (&words)[3], Float& unused) const {
    alignas(64) uint32_t places[L::kLanes];
    L::StoreInt(node, places);
    const float* at[L::kLanes];
#pragma GCC unroll 16
    for (uint32_t i = 0; i < L::kLanes; ++i)
      at[i] = reinterpret_cast<const float*>(tree_.nodes + (places[i] & kPlaceBits));
    L::Gather4(at, 0, words[0], words[1], words[2], unused);
  }
  static Float ByAxis(Mask is_y, Mask is_z, const float (&v)[3][L::kLanes]) {
    return L::Select(is_z, L::Load(v[2]), L::Select(is_y, L::Load(v[1]), L::Load(v[0])));
  }

  const SimtTree& tree_;
  Lanes& lanes_;
  alignas(64) uint32_t node_[L::kLanes] = {};
  alignas(64) float t_[L::kLanes] = {};
};

template <class L>
constexpr SimtFunctions FunctionsFor(const char* isa) {
  return {SimtBrute<L>,
          [](const SimtScene& scene, const SimtGrid& grid, SimtRays rays) {
            SimtTracer<L, SimtGridWay<L>>(scene, grid, rays).Run();
          },
          [](const SimtScene& scene, const SimtTree& tree, SimtRays rays) {
            SimtTracer<L, SimtKdWay<L, false>>(scene, tree, rays).Run();
          },
          [](const SimtScene& scene, const SimtTree& tree, SimtRays rays) {
            SimtTracer<L, SimtKdWay<L, true>>(scene, tree, rays).Run();
          },
          isa};
}

}  // namespace quarry::laboratory

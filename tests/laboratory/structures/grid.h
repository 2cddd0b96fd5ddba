#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "common/base/status.h"
#include "tests/laboratory/structures/accelerator.h"
#include "tests/laboratory/structures/ray_line.h"

namespace quarry::laboratory {

/// Cells along each axis.
using GridResolution = std::array<uint32_t, 3>;

/// Limit of CubicalResolution(): 512 MiB of cells.
inline constexpr double kMostCells = 1 << 27;

/// Nearly cubical cells, `least` of them along the shortest axis of `box`; fewer where all together would be
/// more than kMostCells, as in a flat box. Requires: the box has an extent.
GridResolution CubicalResolution(const Box& box, uint32_t least);

/// The part of a uniform grid that kernels read; it may be copied to another memory. A cell is one word:
/// null, or the place of its list, whose first word is the number of triangles behind it. The paper ends
/// lists by a delimiter instead; with a count the cell stays one word and an empty cell costs one fetch,
/// while Step can tell the whole range.
/// Source: Purcell et al. 2002, section 3.1.2 and figure 4; Fujimoto et al. 1986 and Amanatides & Woo 1987
/// for the way from cell to cell. Differs: the t of a plane comes from the plane's coordinate and is not
/// added up, so that no rounding accumulates (ReferencePadding()); hits beyond the cell are kept, not found
/// again. Immutable, so thread-safe.
class GridView {
 public:
  static constexpr bool kGoesUp = false;
  using Constant = RayLine;
  struct State {
    uint32_t cell[3];
    float t_exit;  ///< where the ray leaves the cell; known once Step has seen the cell
  };

  const GridResolution& resolution() const { return resolution_; }
  QUARRY_HOST_DEVICE const Texture<uint32_t>& cells() const { return cells_; }
  QUARRY_HOST_DEVICE const Texture<uint32_t>& list() const { return list_; }
  const Box& box() const { return box_; }
  /// The width of cells along each axis, scene units.
  const float (&size() const)[3] { return size_; }
  /// Calls f(texture) for each texture that kernels read.
  template <class F>
  Status ForTextures(const F& f) {
    QUARRY_TRY(f(cells_));
    return f(list_);
  }

  /// The lower plane of cells `i` along `axis`, scene units.
  QUARRY_HOST_DEVICE float Plane(uint32_t axis, uint32_t i) const {
    return ScalarLane::Fma(static_cast<float>(i), size_[axis], box_.lower[static_cast<int>(axis)]);
  }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Setup(M&, const RayStart& ray, float t, float t_end, Constant& line,
                                       State& state) const {
    t = ClipToScene(ray, box_, t, t_end, line);
    if (!(t < line.t_end)) return StepOutcome::kOut;
    for (uint32_t a = 0; a < 3; ++a) state.cell[a] = CellAt(ray, line, t, a);
    state.t_exit = t;
    return StepOutcome::kOn;
  }

  /// Looks into one cell, and leaves it if it is empty.
  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Step(M& memory, const Constant& line, State& state,
                                      TriangleRange& range) const {
    const uint32_t place = memory.Fetch(cells_, Index(state));
    if (place == 0) return Advance(line, state);
    uint32_t axis = 0;
    state.t_exit = Exit(line, state, axis);
    range.next = place + 1;
    range.end = range.next + memory.Fetch(list_, place);
    return StepOutcome::kList;
  }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Up(M&, const Constant&, State&) const {
    return StepOutcome::kOut;
  }

  template <class M>
  QUARRY_HOST_DEVICE StepOutcome Leave(M&, const Constant& line, State& state, float best_t) const {
    if (best_t < state.t_exit) return StepOutcome::kOut;
    return Advance(line, state);
  }

 private:
  QUARRY_HOST_DEVICE uint32_t Index(const State& s) const {
    return (s.cell[2] * resolution_[1] + s.cell[1]) * resolution_[0] + s.cell[0];
  }

  /// Where the ray leaves its cell, and across which axis.
  QUARRY_HOST_DEVICE float Exit(const Constant& line, const State& state, uint32_t& axis) const {
    float exit = 0;
    for (uint32_t a = 0; a < 3; ++a) {
      const float t = line.PlaneAt(Plane(a, state.cell[a] + (line.Rises(a) ? 1 : 0)), a);
      if (a == 0 || t < exit) {
        exit = t;
        axis = a;
      }
    }
    return exit;
  }

  QUARRY_HOST_DEVICE StepOutcome Advance(const Constant& line, State& state) const {
    uint32_t axis = 0;
    state.t_exit = Exit(line, state, axis);
    if (!(state.t_exit < line.t_end)) return StepOutcome::kOut;
    const uint32_t last = line.Rises(axis) ? resolution_[axis] - 1 : 0;
    if (state.cell[axis] == last) return StepOutcome::kOut;
    state.cell[axis] += line.Rises(axis) ? 1u : ~0u;
    return StepOutcome::kOn;
  }

  /// The cell along `axis` that holds the ray at `t`: a guess, set right by the t of planes.
  QUARRY_HOST_DEVICE uint32_t CellAt(const RayStart& ray, const Constant& line, float t,
                                     uint32_t axis) const {
    const uint32_t last = resolution_[axis] - 1;
    const float at =
        (ray.origin[axis] + t * ray.direction[axis] - box_.lower[static_cast<int>(axis)]) / size_[axis];
    uint32_t i = at > 0 ? std::min(static_cast<uint32_t>(std::min(at, 1e9f)), last) : 0;
    if (line.Rises(axis)) {
      while (i > 0 && line.PlaneAt(Plane(axis, i), axis) > t) --i;
      while (i < last && line.PlaneAt(Plane(axis, i + 1), axis) <= t) ++i;
    } else {
      while (i < last && line.PlaneAt(Plane(axis, i + 1), axis) > t) ++i;
      while (i > 0 && line.PlaneAt(Plane(axis, i), axis) <= t) --i;
    }
    return i;
  }

  friend class UniformGrid;
  Box box_;
  GridResolution resolution_{};
  float size_[3]{};
  Texture<uint32_t> cells_, list_;
};

/// A grid and its textures. Immutable, so thread-safe.
class UniformGrid : public GridView {
 public:
  /// Each triangle is in all cells that it reaches when grown by `padding` (scene units), and in few others.
  /// Requires: fewer than 2^32 cells.
  UniformGrid(std::span<const KdTriangle> triangles, float padding, const Box& box,
              const GridResolution& resolution, AddressSpace& addresses);
  UniformGrid(const UniformGrid&) = delete;
  UniformGrid& operator=(const UniformGrid&) = delete;

  /// The part that kernels read; it must not outlive this.
  GridView view() const { return *this; }
  uint64_t references() const { return references_; }
  uint64_t bytes() const { return sizeof(uint32_t) * (cell_data_.size() + list_data_.size()); }

 private:
  std::vector<uint32_t> cell_data_, list_data_;
  uint64_t references_ = 0;
};

}  // namespace quarry::laboratory

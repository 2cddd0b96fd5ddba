#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "common/kdtree/build.h"

namespace quarry {

/// Counts of box ends over a node, at a fixed resolution on each axis. The plane chosen from it is a function
/// of the node's triangles alone: never of the memory at hand or of whether they lie in memory or on disk.
class SplitHistogram {
 public:
  static constexpr int kBins = 256;

  /// `content`: the bounds of the node's boxes, clipped to its cell.
  explicit SplitHistogram(const Box& content);
  void Add(const Box& box);

  struct Plane {
    int axis = -1;  ///< -1: no plane parts the triangles usefully; make a chain
    float position = 0;
    double growth = 1;  ///< triangles in both children together, over those in the node
  };
  /// The plane of least SAH cost among bin borders and the ends of the content (which cut off empty space),
  /// or, when that leaves a child with nearly all triangles and not much smaller a surface, the one with the
  /// smallest larger child.
  Plane Choose(const Box& cell) const;

 private:
  size_t Bin(float x, int axis) const;
  Box content_;
  float bins_per_unit_[3];
  uint64_t count_ = 0;
  std::array<std::array<uint64_t, kBins>, 3> starts_{}, ends_{};
};

}  // namespace quarry

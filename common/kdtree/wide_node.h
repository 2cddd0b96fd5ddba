#pragma once

#include <cstdint>

namespace quarry {

/// Up to eight cells of a kd-tree, arranged for tests of a ray against vectors of boxes. Boxes (scene units)
/// are cut down to their content; empty cells are left out. Cells do not overlap: a ray passes them one after
/// the other.
struct alignas(16) WideNode {
  static constexpr uint32_t kChildren = 8;
  static constexpr uint16_t kInner = 0xFFFF;

  /// Shapes: lower x of all children, then lower y, lower z, upper x, upper y, upper z. The box of an absent
  /// child is infinite and empty.
  float bounds[6 * kChildren] = {};
  /// The index in `bounds` of the first lower or upper bound across an axis.
  static constexpr uint32_t Face(uint32_t axis, bool upper) { return (upper ? axis + 3 : axis) * kChildren; }
  uint32_t child[kChildren] = {};  ///< index of a node; of a leaf: first reference, or voxel
  uint16_t count[kChildren] = {};  ///< references or voxels of a leaf; kInner: an inner node
  uint32_t parent = 0;             ///< 8 * parent + this node's place in the parent
  /// Per octant of rays with positive z, the order in which they pass the children, three bits each. Bit 0 of
  /// the octant is set for negative x, bit 1 for negative y. Rays of the opposite octant pass the children in
  /// reverse order.
  uint8_t order[4][3] = {};

  uint32_t Order(uint32_t octant) const {
    return order[octant][0] | uint32_t{order[octant][1]} << 8 | uint32_t{order[octant][2]} << 16;
  }
};
static_assert(sizeof(WideNode) == 256);

}  // namespace quarry

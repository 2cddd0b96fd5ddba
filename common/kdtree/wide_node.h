#pragma once

#include <cstdint>

namespace quarry {

/// Up to eight cells of a kd-tree side by side, for one ray against vectors of boxes. Boxes (scene units) are
/// cut down to their content; empty cells have no place. Cells do not overlap: a ray passes them one after
/// the other.
struct alignas(16) WideNode {
  static constexpr uint32_t kChildren = 8;
  static constexpr uint16_t kInner = 0xFFFF;

  /// The children's lower x, one after the other, lower y, z, upper x, y, z; infinite, and empty, where there
  /// is no child.
  float bounds[6 * kChildren] = {};
  /// Where in `bounds` the lower or upper bounds across an axis begin.
  static constexpr uint32_t Face(uint32_t axis, bool upper) { return (upper ? axis + 3 : axis) * kChildren; }
  uint32_t child[kChildren] = {};  ///< the node; of a leaf: the first reference, or voxel
  uint16_t count[kChildren] = {};  ///< of a leaf's references, or voxels; kInner: not a leaf
  uint32_t parent = 0;             ///< parent * 8 + this node's place among its children
  /// The order in which rays that go up in z pass the children, three bits each, by octant: bit 0 set where
  /// rays go down in x, bit 1 in y. Rays of the opposite octant pass the children in reverse order.
  uint8_t order[4][3] = {};

  uint32_t Order(uint32_t octant) const {
    return order[octant][0] | uint32_t{order[octant][1]} << 8 | uint32_t{order[octant][2]} << 16;
  }
};
static_assert(sizeof(WideNode) == 256);

}  // namespace quarry

#pragma once

#include <cstdint>
#include <limits>

#include "common/math/host_device.h"

namespace quarry {

/// Records whether the nodes above the present node have cells ahead: a bit per level instead of a stack.
/// Nodes more than 63 levels above count as having cells ahead.
/// Source: Áfra & Szirmay-Kalos 2014, "Stackless Multi-BVH Traversal for CPU, MIC and GPU Ray Tracing".
class WideTrail {
 public:
  QUARRY_HOST_DEVICE bool empty() const { return levels_ == 0; }
  /// Goes to a child. `more`: the parent has other cells ahead.
  QUARRY_HOST_DEVICE void Down(bool more) {
    levels_ = static_cast<int64_t>(static_cast<uint64_t>(levels_) << 1) | (levels_ & kMany) | (more ? 1 : 0);
  }
  /// Goes to the parent. Returns: whether the parent has cells ahead.
  QUARRY_HOST_DEVICE bool Up() {
    const bool more = (levels_ & 1) != 0;
    levels_ >>= 1;
    return more;
  }

 private:
  static constexpr int64_t kMany = std::numeric_limits<int64_t>::min();
  int64_t levels_ = 0;  ///< bit i: the node i + 1 levels up; the sign stands for all above the others
};

}  // namespace quarry

#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/ray_packet.h"
#include "common/math/host_device.h"

namespace quarry {

/// The rays that a kernel has yet to start. Shapes: bit i of masks[p] selects ray i of packets[p]. Not
/// thread-safe.
struct RaySource {
  RayPacket* packets;
  const uint64_t* masks;
  uint32_t count, next = 0;
  uint64_t left = 0;

  /// Takes the next ray, ray `index` of `packet`. Returns: false when no ray is left.
  QUARRY_HOST_DEVICE bool Next(RayPacket*& packet, uint32_t& index) {
    while (left == 0) {
      if (next == count) return false;
      left = masks[next++];
    }
    packet = packets + next - 1;
    index = static_cast<uint32_t>(std::countr_zero(left));
    left &= left - 1;
    return true;
  }
};

}  // namespace quarry

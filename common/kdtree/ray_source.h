#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/ray_packet.h"
#include "common/math/host_device.h"

namespace quarry {

/// Rays yet to start: bit i of masks[p] names ray i of packets[p]. One thread at a time.
struct RaySource {
  RayPacket* packets;
  const uint64_t* masks;
  uint32_t count, next = 0;
  uint64_t left = 0;

  /// Takes the next ray: ray `index` of `packet`. False when no ray is left.
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

#pragma once

#include <bit>
#include <cstdint>

#include "common/kdtree/ray_packet.h"

// Sets of a packet's lanes, a bit each.

namespace quarry {

/// Calls body(i) for each lane i in `lanes`.
template <class Body>
void ForEachLane(uint64_t lanes, Body&& body) {
  for (; lanes != 0; lanes &= lanes - 1) body(static_cast<uint32_t>(std::countr_zero(lanes)));
}

/// The lanes i with values[i] == value.
inline uint64_t LanesWith(uint32_t value, const uint32_t (&values)[RayPacket::kRays]) {
  uint64_t lanes = 0;
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) lanes |= uint64_t{values[i] == value} << i;
  return lanes;
}

/// The same of small values.
inline uint64_t LanesAt(uint32_t value, const uint8_t (&values)[RayPacket::kRays]) {
  uint64_t lanes = 0;
  for (uint32_t i = 0; i < RayPacket::kRays; ++i) lanes |= uint64_t{values[i] == value} << i;
  return lanes;
}

}  // namespace quarry

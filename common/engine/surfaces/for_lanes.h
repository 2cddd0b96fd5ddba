#pragma once

#include <cstdint>

#include "common/engine/surfaces/surface_packet.h"

// Loops over the lanes of a packet that become vector instructions, in files that are compiled for it.

namespace quarry {

/// Calls body(i, whether lane i is in `lanes`) for every vector of 8 lanes that has one. `body` selects
/// instead of branching, so that it becomes vector instructions.
template <class Body>
inline void ForLanes(uint64_t lanes, Body&& body) {
  constexpr int kVector = 8, kHalf = 32, kLanes = RayPacket::kRays;
  uint32_t meant[kLanes];
  for (int i = 0; i < kHalf; ++i) {
    meant[i] = static_cast<uint32_t>(lanes) >> i & 1;
    meant[kHalf + i] = static_cast<uint32_t>(lanes >> kHalf) >> i & 1;
  }
  for (int first = 0; first < kLanes; first += kVector) {
    if ((lanes >> first & ((1u << kVector) - 1)) == 0) continue;
#pragma GCC ivdep
    for (int i = first; i < first + kVector; ++i) body(i, meant[i] != 0);
  }
}

inline void Put(bool meant, int i, const glm::vec3& value, Vectors& to) {
  to.x[i] = meant ? value.x : to.x[i];
  to.y[i] = meant ? value.y : to.y[i];
  to.z[i] = meant ? value.z : to.z[i];
}

template <class T>
inline void Put(bool meant, int i, T value, T (&to)[RayPacket::kRays]) {
  to[i] = meant ? value : to[i];
}

}  // namespace quarry

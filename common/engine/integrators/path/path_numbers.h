#pragma once

#include <cstdint>
#include <glm/vec2.hpp>

#include "common/engine/sample_packet.h"

namespace quarry {

/// The random numbers of vertices in a packet, one array per slot and dimension: all that a vertex of mode
/// `path` may need. See SobolSample().
struct PathNumbers {
  /// The use of a slot's two numbers.
  enum Slot : uint32_t { kDirection, kChoice, kLight, kLightPlace, kSlots };

  glm::vec2 At(Slot slot, uint32_t lane) const { return {x[slot][lane], y[slot][lane]}; }
  /// Sets the numbers of the vertices of `lanes`, by their samples and depths.
  void Draw(uint64_t seed, const SamplePacket& samples, uint64_t lanes);

  float x[kSlots][RayPacket::kRays], y[kSlots][RayPacket::kRays];
};

}  // namespace quarry

#pragma once

#include <cstdint>

#include "common/kdtree/ray_packet.h"

namespace quarry {

/// The hits of a packet's rays on triangles with cut-outs, while it is found out whether they lie in holes:
/// one array per field. Tiles of scenes without cut-outs have none. Memory: 1,088 bytes.
struct CutPacket {
  /// Values of `texels` before a lookup: the hit's hot block, then its shading block is needed. kThere: the
  /// hit lies in no hole.
  static constexpr uint8_t kUnseen = 0xFF, kWantsUv = 0xFE, kThere = 0xFD;

  float u[RayPacket::kRays], v[RayPacket::kRays];
  float opacity[RayPacket::kRays];  ///< sum of the texels so far
  uint32_t material[RayPacket::kRays];
  uint8_t texels[RayPacket::kRays];  ///< in the sum
};

}  // namespace quarry

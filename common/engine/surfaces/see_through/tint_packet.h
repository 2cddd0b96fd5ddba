#pragma once

#include <cstdint>

#include "common/kdtree/ray_packet.h"

namespace quarry {

/// The panes that a packet's light rays have hit, while the textures that tint them are looked up: one array
/// per field. Tiles of scenes without such panes have none. Memory: 1,600 bytes.
struct TintPacket {
  /// Values of `texels` before a lookup: the hit's hot block, then its shading block is needed.
  static constexpr uint8_t kUnseen = 0xFF, kWantsUv = 0xFE;
  /// Values of `texels` afterwards: the sum is complete; the pane has no texture that tints.
  static constexpr uint8_t kDone = 0xFD, kPlain = 0xFC;

  float u[RayPacket::kRays], v[RayPacket::kRays];
  float sum[3][RayPacket::kRays];  ///< of the texels so far
  uint32_t material[RayPacket::kRays];
  uint8_t texels[RayPacket::kRays];  ///< in the sum
};

}  // namespace quarry

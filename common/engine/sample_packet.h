#pragma once

#include <cstdint>

#include "common/engine/shading/shading_packet.h"
#include "common/kdtree/ray_packet.h"

namespace quarry {

/// The samples of a packet, field by field; the ray that each has under way is in a RayPacket at the same
/// lane.
struct SamplePacket {
  /// What a sample is about to do; each step is taken for all samples of a packet together.
  enum Stage { kTraverse, kSurface, kAttributes, kShade, kLight, kShadow, kBounce, kNext, kStages };
  static constexpr int kLanes = RayPacket::kRays;

  uint64_t at[kStages];  ///< lanes, by stage
  SurfacePacket surface;
  Vectors weight;
  Vectors light;  ///< what the shadow ray brings if nothing is in its way
  float t_offset[kLanes];
  uint32_t sample[kLanes];
  uint32_t path_code[kLanes];
  uint32_t next_light[kLanes];   ///< the light, in kAo the occlusion ray, to be sent next
  uint32_t image_pixel[kLanes];  ///< y * width + x in the view
  uint16_t pixel[kLanes];
  uint16_t depth_cell[kLanes];
  uint8_t depth[kLanes];
  uint8_t pending_count[kLanes];

  void Move(uint64_t lanes, Stage from, Stage to) {
    at[from] &= ~lanes;
    at[to] |= lanes;
  }
};

}  // namespace quarry

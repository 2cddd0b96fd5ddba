#pragma once

#include <algorithm>
#include <cstdint>

#include "common/engine/surfaces/surface_packet.h"
#include "common/kdtree/ray_packet.h"
#include "common/math/random.h"

namespace quarry {

/// The samples of a packet, one array per field. The ray of a sample is in the RayPacket at the same lane.
struct SamplePacket {
  /// The next step of a sample. A step is done for all samples of a packet together. A hit may be one that
  /// does not count (kTest). A light ray, to a light or for occlusion, first looks for an opaque occluder
  /// (kShadow); one that has met see-through surfaces instead goes from one to the next (kPass), if there are
  /// several, and each tints its light (kTint).
  enum Stage {
    kTraverse,
    kTest,
    kSurface,
    kAttributes,
    kTextures,
    kShade,
    kLight,
    kShadow,
    kPass,
    kTint,
    kBounce,
    kNext,
    kStages
  };
  static constexpr int kLanes = RayPacket::kRays;

  uint64_t at[kStages];  ///< lanes in each stage
  uint64_t capped;       ///< lanes whose surface is a cap of the section
  uint64_t colored;      ///< lanes whose part has a colour of the view's
  SurfacePacket surface;
  Vectors weight;
  Vectors light;           ///< radiance that the shadow ray adds if nothing more blocks it
  float t_offset[kLanes];  ///< from where the sample's depth counts to the first ray's origin
  float t_end[kLanes];     ///< where the ray under way to its nearest hit ends
  uint32_t sample[kLanes];
  uint32_t path_code[kLanes];
  uint32_t next_light[kLanes];   ///< the light, or occlusion ray, to be sent next
  uint32_t image_pixel[kLanes];  ///< y * width + x in the view
  uint16_t pixel[kLanes];
  uint16_t depth_cell[kLanes];
  uint8_t depth[kLanes];
  uint8_t pending_count[kLanes];
  uint8_t passed[kLanes];  ///< see-through surfaces that the shadow ray has passed

  /// Begins paths in all lanes: primary rays of full weight.
  void BeginPaths() {
    std::fill_n(weight.x, kLanes, 1.0f);
    std::fill_n(weight.y, kLanes, 1.0f);
    std::fill_n(weight.z, kLanes, 1.0f);
    std::fill_n(t_end, kLanes, kInfinity);
    std::fill_n(path_code, kLanes, kPrimaryPath);
    std::fill_n(depth, kLanes, uint8_t{0});
    std::fill_n(pending_count, kLanes, uint8_t{0});
  }
  /// The same in one lane.
  void BeginPath(uint32_t lane) {
    weight.Set(static_cast<int>(lane), glm::vec3(1));
    t_end[lane] = kInfinity;
    path_code[lane] = kPrimaryPath;
    depth[lane] = pending_count[lane] = 0;
  }
  void Move(uint64_t lanes, Stage from, Stage to) {
    at[from] &= ~lanes;
    at[to] |= lanes;
  }
};

}  // namespace quarry

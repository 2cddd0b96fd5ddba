#pragma once

#include <string>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "common/scene/render_job.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry::bench {

/// Rays of one kind, in packets of 8x8 pixels.
struct RaySet {
  std::string name;
  bool any = false;       ///< shadow rays
  bool coherent = false;  ///< neighbours go much the same way
  std::vector<RayPacket> packets;
  std::vector<uint64_t> active;
  uint64_t rays = 0;
};

/// Primary rays of `size` x `size` pixels, and rays from their hits: shadow rays to the sun, mirror rays and
/// diffuse bounces.
std::vector<RaySet> MakeRaySets(const test::ResidentScene& scene, uint32_t size, const CameraSpec& view);

}  // namespace quarry::bench

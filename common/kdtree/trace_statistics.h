#pragma once

#include <cstdint>

namespace quarry {

/// Counts of a kernel's work, for `quarry bench`. Pairs of lanes: used and available.
struct TraceStatistics {
  uint64_t rays = 0;
  uint64_t node_steps = 0, node_lanes_used = 0, node_lanes = 0;
  uint64_t leaves = 0;  ///< visits, by packets or by single rays
  uint64_t triangle_tests = 0, triangle_lanes_used = 0, triangle_lanes = 0;
  uint64_t exact_tests = 0;   ///< vectors tested in double
  uint64_t climbs = 0;        ///< steps up or restarts
  uint64_t voxel_visits = 0;  ///< by packets or by single rays
  uint64_t voxel_rays = 0;    ///< rays in these visits

  void Ray(uint32_t count) { rays += count; }
  void Node(uint32_t used, uint32_t lanes) {
    ++node_steps;
    node_lanes_used += used;
    node_lanes += lanes;
  }
  void Leaf(uint32_t visits) { leaves += visits; }
  void Triangle(uint32_t used, uint32_t lanes) {
    ++triangle_tests;
    triangle_lanes_used += used;
    triangle_lanes += lanes;
  }
  void Exact() { ++exact_tests; }
  void Climb() { ++climbs; }
  void Voxel(uint32_t count) {
    ++voxel_visits;
    voxel_rays += count;
  }
};

}  // namespace quarry

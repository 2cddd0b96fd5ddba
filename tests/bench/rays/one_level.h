#pragma once

#include <memory>
#include <vector>

#include "common/kdtree/kernels.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry::bench {

/// All triangles of a scene under one tree by the same builder, without voxels: the yardstick for the cost of
/// two levels. Indices have 32 bits.
class OneLevelScene {
 public:
  explicit OneLevelScene(const test::ResidentScene& scene);

  /// As TraceFunction, by packets or by streams.
  void Trace(RayPacket* packets, const uint64_t* active, uint32_t count, Grouping grouping, bool any) const;

 private:
  std::vector<KdNode> top_, nodes_;
  std::vector<WideNode> top_wide_, wide_;
  std::vector<uint32_t> references_, corners_, ids_;
  std::vector<glm::vec3> vertices_;
  VoxelBounds bounds_;
  TopTree tree_;
  VoxelGeometryOf<uint32_t> geometry_;
};

}  // namespace quarry::bench

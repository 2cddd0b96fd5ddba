#pragma once

#include <cstdint>
#include <glm/vec3.hpp>

#include "common/kdtree/node.h"

namespace quarry {

/// The hot part of a resident voxel, as kernels see it: pointers into one decoded block, valid while it is
/// pinned. Every index was checked when the block was decoded.
struct VoxelGeometry {
  const KdNode* nodes = nullptr;
  const uint16_t* references = nullptr;    ///< leaves' ranges: local triangle indices
  const uint16_t* corners = nullptr;       ///< three local vertex indices a triangle
  const glm::vec3* vertices = nullptr;     ///< scene units, the input's precision
  const uint32_t* triangle_ids = nullptr;  ///< scene-wide ids
  const uint16_t* materials = nullptr;     ///< a triangle's material
  const uint32_t* parts = nullptr;         ///< a triangle's part
  uint32_t node_count = 0, reference_count = 0, triangle_count = 0, vertex_count = 0;

  const glm::vec3& vertex(uint32_t triangle, int corner) const {
    return vertices[corners[3 * triangle + static_cast<uint32_t>(corner)]];
  }
};

/// The top-level tree, whole on every worker: leaves are voxels or empty.
struct TopTree {
  const KdNode* nodes = nullptr;
  const uint32_t* next_in_chain = nullptr;  ///< per voxel: the next voxel of the same leaf, or kNoVoxel
  glm::vec3 lower{0}, upper{0};             ///< the root's box: the scene's bounds, padded
};

}  // namespace quarry

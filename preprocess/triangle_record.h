#pragma once

#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <type_traits>

#include "common/kdtree/build.h"
#include "common/voxel/voxel_block.h"

namespace quarry {

/// A triangle on its way through the preprocessor, self-contained, as spilled to disk (never stored). The
/// last member is spilled only when the scene has any normals, uvs or colours: see RecordBytes.
struct TriangleRecord {
  glm::vec3 vertices[3];
  uint32_t id = 0;
  uint32_t part = 0;
  uint32_t material = 0;
  ShadingVertex shading[3];

  /// The triangle's box, grown by `padding` on every side.
  Box PaddedBox(float padding) const {
    Box box{vertices[0], vertices[0]};
    box.Include(vertices[1]);
    box.Include(vertices[2]);
    box.lower -= glm::vec3(padding);
    box.upper += glm::vec3(padding);
    return box;
  }
};
static_assert(std::is_trivially_copyable_v<TriangleRecord> && sizeof(TriangleRecord) == 48 + 72);

/// Bytes of a record in spill files.
inline size_t RecordBytes(bool has_shading) { return has_shading ? sizeof(TriangleRecord) : 48; }

}  // namespace quarry

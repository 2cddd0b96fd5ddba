#pragma once

#include <cstddef>
#include <cstdint>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <type_traits>

#include "common/kdtree/build.h"
#include "common/voxel/voxel_block.h"

namespace quarry {

/// What a scene's triangles have beside positions, each with all that come before it.
enum class Attributes : uint8_t { kNone, kColors, kNormals, kUvs };

/// A triangle on its way through the preprocessor, self-contained, as spilled to disk (never stored): as much
/// of it as the scene has attributes for, see RecordBytes.
struct TriangleRecord {
  glm::vec3 vertices[3];
  uint32_t id = 0;
  uint32_t part = 0;
  uint32_t material = 0;
  uint32_t colors[3] = {0xFFFFFFFFu, 0xFFFFFFFFu, 0xFFFFFFFFu};  ///< as ShadingVertex has them
  glm::vec3 normals[3] = {};
  glm::vec2 uvs[3] = {};

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
static_assert(std::is_trivially_copyable_v<TriangleRecord> && sizeof(TriangleRecord) == 120);

/// Bytes of a record in spill files.
inline size_t RecordBytes(Attributes attributes) {
  switch (attributes) {
    case Attributes::kNone:
      return offsetof(TriangleRecord, colors);
    case Attributes::kColors:
      return offsetof(TriangleRecord, normals);
    case Attributes::kNormals:
      return offsetof(TriangleRecord, uvs);
    case Attributes::kUvs:
      break;
  }
  return sizeof(TriangleRecord);
}

}  // namespace quarry

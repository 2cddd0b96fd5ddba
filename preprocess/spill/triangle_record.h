#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <glm/vec2.hpp>
#include <glm/vec3.hpp>
#include <type_traits>

#include "common/kdtree/build/build.h"
#include "common/voxel/voxel_block.h"
#include "preprocess/import/smoothing.h"

namespace quarry {

/// The attributes of a scene's triangles beside positions; each value includes the values before it.
enum class Attributes : uint8_t { kNone, kColors, kNormals, kUvs };

/// A self-contained triangle, as spilled to disk (never stored): its first RecordBytes(attributes) bytes.
/// Units: scene units; colours as ShadingVertex has them.
struct TriangleRecord {
  glm::vec3 vertices[3];
  uint32_t id = 0;
  uint32_t part = 0;
  uint16_t material = 0;
  uint16_t smoothing = kSmoothByAngle;  ///< how normals that it lacks are made, see import/smoothing.h
  uint32_t colors[3] = {0xFFFFFFFFu, 0xFFFFFFFFu, 0xFFFFFFFFu};  ///< packed, see ShadingVertex
  glm::vec3 normals[3] = {};
  glm::vec2 uvs[3] = {};

  /// The triangle's box, grown by `padding` on every side.
  Box PaddedBox(float padding) const {
    Box box;
    for (int a = 0; a < 3; ++a) {
      const float x = vertices[0][a], y = vertices[1][a], z = vertices[2][a];
      box.lower[a] = std::min(std::min(x, y), z) - padding;
      box.upper[a] = std::max(std::max(x, y), z) + padding;
    }
    return box;
  }
};
static_assert(std::is_trivially_copyable_v<TriangleRecord> && sizeof(TriangleRecord) == 120);

/// Whether a normal of a model is one: finite, and not zero.
inline bool IsNormal(const glm::vec3& n) {
  const float length2 = n.x * n.x + n.y * n.y + n.z * n.z;
  return length2 > 1e-30f && length2 < 1e30f;
}

/// Whether a triangle lacks normals and is smoothed with others.
inline bool IsSmoothed(const TriangleRecord& t) { return t.smoothing != kFlat && t.smoothing != kOwnNormals; }

/// The unit normal of a triangle's plane. Requires: FaultOf(t) is kNone.
inline glm::vec3 FacetNormal(const TriangleRecord& t) {
  const glm::dvec3 a = glm::dvec3(t.vertices[1]) - glm::dvec3(t.vertices[0]);
  const glm::dvec3 b = glm::dvec3(t.vertices[2]) - glm::dvec3(t.vertices[0]);
  const glm::dvec3 n(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
  return glm::vec3(n * (1 / std::sqrt(n.x * n.x + n.y * n.y + n.z * n.z)));
}

/// Marks a triangle that has a normal at any corner, so that it is not smoothed.
inline void MarkOwnNormals(TriangleRecord& t) {
  if (IsNormal(t.normals[0]) || IsNormal(t.normals[1]) || IsNormal(t.normals[2])) t.smoothing = kOwnNormals;
}

/// Why a triangle is dropped.
enum class TriangleFault { kNone, kNotFinite, kDegenerate };

inline TriangleFault FaultOf(const TriangleRecord& r) {
  constexpr float kLargestCoordinate = 0x1p60f;
  for (const glm::vec3& p : r.vertices)
    for (int axis = 0; axis < 3; ++axis)
      if (!(std::fabs(p[axis]) <= kLargestCoordinate)) return TriangleFault::kNotFinite;
  const glm::dvec3 a = glm::dvec3(r.vertices[1]) - glm::dvec3(r.vertices[0]);
  const glm::dvec3 b = glm::dvec3(r.vertices[2]) - glm::dvec3(r.vertices[0]);
  const bool area = a.y * b.z != a.z * b.y || a.z * b.x != a.x * b.z || a.x * b.y != a.y * b.x;
  return area ? TriangleFault::kNone : TriangleFault::kDegenerate;
}

/// Bytes of a record in spill files; see CopyRecord().
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

/// Takes a record over from a spill file: its first `bytes` bytes. The rest stays as it is. A copy of a known
/// number of bytes needs no call.
inline void CopyRecord(const std::byte* from, size_t bytes, TriangleRecord& record) {
  constexpr size_t kLeast = offsetof(TriangleRecord, colors);
  if (bytes == kLeast)
    std::memcpy(static_cast<void*>(&record), from, kLeast);
  else
    std::memcpy(static_cast<void*>(&record), from, bytes);
}

}  // namespace quarry

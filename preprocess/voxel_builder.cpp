#include "preprocess/voxel_builder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

namespace quarry {
namespace {

/// Numbers values by first appearance; equal means equal bits. Open addressing, at most half full.
template <class T>
class Interner {
 public:
  explicit Interner(size_t most) : table_(std::bit_ceil(most * 2 + 2), kFree) {}

  uint16_t Index(const T& value, std::vector<T>& values) {
    uint32_t words[sizeof(T) / 4];
    std::memcpy(words, &value, sizeof value);
    uint64_t hash = 0;
    for (uint32_t word : words) hash = (hash ^ word) * 0x9E3779B97F4A7C15ull;
    size_t at = (hash >> 32) & (table_.size() - 1);
    while (table_[at] != kFree && std::memcmp(&values[table_[at]], &value, sizeof value) != 0)
      at = (at + 1) & (table_.size() - 1);
    if (table_[at] == kFree) {
      table_[at] = static_cast<uint32_t>(values.size());
      values.push_back(value);
    }
    return static_cast<uint16_t>(table_[at]);
  }

 private:
  static constexpr uint32_t kFree = 0xFFFFFFFFu;
  std::vector<uint32_t> table_;  ///< indices into the values
};

ShadingVertex Sanitized(ShadingVertex v) {
  const float length2 = v.normal.x * v.normal.x + v.normal.y * v.normal.y + v.normal.z * v.normal.z;
  if (!(length2 > 1e-30f && length2 < 1e30f)) v.normal = glm::vec3(0);
  if (!std::isfinite(v.uv.x) || !std::isfinite(v.uv.y)) v.uv = glm::vec2(0);
  return v;
}

Bytes BuildShading(std::span<const TriangleRecord> triangles) {
  ShadingVoxel voxel;
  Interner<ShadingVertex> interner(triangles.size() * 3);
  for (const TriangleRecord& t : triangles)
    for (const ShadingVertex& v : t.shading)
      voxel.corners.push_back(interner.Index(Sanitized(v), voxel.vertices));
  return LayOutShading(voxel);
}

}  // namespace

uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size) {
  const size_t fixed = HotBytes(1, 0, 0, 0);
  const size_t each = HotBytes(1, 1, 1, 3) - fixed;
  return static_cast<uint32_t>(
      std::clamp<size_t>((voxel_size - std::min<size_t>(voxel_size, fixed)) / each, 1, kMaxVoxelTriangles));
}

EncodedVoxel BuildVoxel(std::span<const TriangleRecord> triangles, const Box& cell, float padding,
                        bool has_shading, uint32_t voxel_size) {
  HotVoxel voxel;
  Interner<glm::vec3> interner(triangles.size() * 3);
  std::vector<Box> boxes;
  boxes.reserve(triangles.size());
  for (const TriangleRecord& t : triangles) {
    boxes.push_back(t.PaddedBox(padding));
    for (const glm::vec3& v : t.vertices) voxel.corners.push_back(interner.Index(v, voxel.vertices));
    voxel.triangle_ids.push_back(t.id);
    voxel.materials.push_back(static_cast<uint16_t>(t.material));
    voxel.parts.push_back(t.part);
  }
  const size_t without_tree = HotBytes(0, 0, triangles.size(), voxel.vertices.size());
  const size_t room = voxel_size > without_tree ? voxel_size - without_tree : 0;
  KdTree tree = BuildKdTree(boxes, cell, SahCosts{}, room);
  voxel.nodes = std::move(tree.nodes);
  voxel.references = std::move(tree.references);
  const Bytes shading = has_shading ? BuildShading(triangles) : Bytes{};
  return EncodeVoxel(LayOutHot(voxel), shading, static_cast<uint32_t>(triangles.size()));
}

}  // namespace quarry

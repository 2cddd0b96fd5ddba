#include "preprocess/voxel_builder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <string_view>
#include <unordered_map>

namespace quarry {
namespace {

/// Numbers values by first appearance; equal means equal bits.
template <class T>
class Interner {
 public:
  uint16_t Index(const T& value, std::vector<T>& values) {
    const std::string_view key(reinterpret_cast<const char*>(&value), sizeof value);
    const auto [it, added] = index_.emplace(std::string(key), static_cast<uint16_t>(values.size()));
    if (added) values.push_back(value);
    return it->second;
  }

 private:
  std::unordered_map<std::string, uint16_t> index_;
};

ShadingVertex Sanitized(ShadingVertex v) {
  const float length2 = v.normal.x * v.normal.x + v.normal.y * v.normal.y + v.normal.z * v.normal.z;
  if (!(length2 > 1e-30f && length2 < 1e30f)) v.normal = glm::vec3(0);
  if (!std::isfinite(v.uv.x) || !std::isfinite(v.uv.y)) v.uv = glm::vec2(0);
  return v;
}

Bytes BuildShading(std::span<const TriangleRecord> triangles) {
  ShadingVoxel voxel;
  Interner<ShadingVertex> interner;
  for (const TriangleRecord& t : triangles)
    for (const ShadingVertex& v : t.shading) voxel.corners.push_back(interner.Index(Sanitized(v), voxel.vertices));
  return LayOutShading(voxel);
}

}  // namespace

uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size) {
  const size_t fixed = HotBytes(1, 0, 0, 0);
  const size_t each = HotBytes(1, 1, 1, 3) - fixed;
  return static_cast<uint32_t>(
      std::clamp<size_t>((voxel_size - std::min<size_t>(voxel_size, fixed)) / each, 1, kMaxVoxelTriangles));
}

EncodedVoxel BuildVoxel(std::span<const TriangleRecord> triangles, const Box& cell, float padding, bool has_shading,
                        uint32_t voxel_size) {
  HotVoxel voxel;
  Interner<glm::vec3> interner;
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

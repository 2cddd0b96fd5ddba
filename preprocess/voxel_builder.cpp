#include "preprocess/voxel_builder.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

#include "common/kdtree/treelets.h"
#include "common/kdtree/wide_tree.h"

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

ShadingVoxel BuildShading(std::span<const TriangleRecord> triangles) {
  ShadingVoxel voxel;
  Interner<ShadingVertex> interner(triangles.size() * 3);
  for (const TriangleRecord& t : triangles)
    for (const ShadingVertex& v : t.shading)
      voxel.corners.push_back(interner.Index(Sanitized(v), voxel.vertices));
  return voxel;
}

}  // namespace

uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size) {
  const size_t fixed = HotBytes(kTreeletHeaderSlots, 1, 0, 0, 0);
  const size_t each = HotBytes(kTreeletHeaderSlots, 1, 1, 1, 3) - fixed;
  return static_cast<uint32_t>(
      std::clamp<size_t>((voxel_size - std::min<size_t>(voxel_size, fixed)) / each, 1, kMaxVoxelTriangles));
}

namespace {

struct VoxelTree {
  KdTree tree;
  uint32_t node_slots, wide_nodes;
};

/// The tree over `triangles` whose layout takes at most `room` bytes.
VoxelTree BuildTree(std::span<const TriangleRecord> triangles, const Box& cell, float padding, size_t room) {
  std::vector<KdTriangle> vertices;
  vertices.reserve(triangles.size());
  for (const TriangleRecord& t : triangles)
    vertices.push_back({{t.vertices[0], t.vertices[1], t.vertices[2]}});
  // Headers and wide nodes take about 7/9 of what the tree itself does; how much, shows only in the layout.
  for (size_t budget = room / 16 * 9;; budget = budget / 4 * 3) {
    KdTree tree = BuildKdTree(vertices, padding, cell, SahCosts{}, budget);
    const size_t slots = TreeletLayout(kTreeletLevels).Slots(tree.nodes);
    const size_t wide_nodes =
        MakeWideTree(tree.nodes, cell, kWideLeafReferences, [](const KdNode&, const Box& box) {
          return box;
        }).size();
    if (HotBytes(slots, wide_nodes, tree.references.size(), 0, 0) <= room || slots == kTreeletHeaderSlots)
      return {std::move(tree), static_cast<uint32_t>(slots), static_cast<uint32_t>(wide_nodes)};
  }
}

/// The triangles in the order in which leaves first refer to them, which is renumbered: what one leaf needs
/// lies together.
std::vector<uint16_t> OrderByLeaves(std::vector<uint32_t>& references, size_t triangles) {
  constexpr uint16_t kUnseen = 0xFFFF;
  std::vector<uint16_t> number(triangles, kUnseen), order;
  order.reserve(triangles);
  const auto visit = [&](uint16_t triangle) {
    if (number[triangle] == kUnseen) {
      number[triangle] = static_cast<uint16_t>(order.size());
      order.push_back(triangle);
    }
    return number[triangle];
  };
  for (uint32_t& reference : references) reference = visit(static_cast<uint16_t>(reference));
  // The partition gave the voxel a triangle by its box; the tree has found that it does not reach the cell.
  for (size_t i = 0; i < triangles; ++i) visit(static_cast<uint16_t>(i));
  return order;
}

}  // namespace

EncodedVoxel BuildVoxel(std::span<const TriangleRecord> triangles, const Box& cell, float padding,
                        bool has_shading, uint32_t voxel_size) {
  const auto vertices_of = [&](HotVoxel& voxel, std::span<const uint16_t> order) {
    Interner<glm::vec3> interner(triangles.size() * 3);
    for (uint16_t i : order)
      for (const glm::vec3& v : triangles[i].vertices)
        voxel.corners.push_back(interner.Index(v, voxel.vertices));
  };
  std::vector<uint16_t> order(triangles.size());
  std::iota(order.begin(), order.end(), uint16_t{0});
  HotVoxel counted;
  vertices_of(counted, order);
  const size_t without_tree =
      HotBytes(0, 0, 0, triangles.size(), counted.vertices.size()) - HotBytes(0, 0, 0, 0, 0);
  const size_t room = voxel_size > without_tree ? voxel_size - without_tree : 0;

  HotVoxel voxel;
  voxel.cell = cell;
  auto [tree, node_slots, wide_nodes] = BuildTree(triangles, cell, padding, room);
  order = OrderByLeaves(tree.references, triangles.size());
  voxel.nodes = std::move(tree.nodes);
  voxel.node_slots = node_slots;
  voxel.wide_nodes = wide_nodes;
  voxel.references.assign(tree.references.begin(), tree.references.end());
  vertices_of(voxel, order);
  std::vector<TriangleRecord> ordered;
  ordered.reserve(order.size());
  for (uint16_t i : order) {
    const TriangleRecord& t = triangles[i];
    voxel.triangle_ids.push_back(t.id);
    voxel.materials.push_back(static_cast<uint16_t>(t.material));
    voxel.parts.push_back(t.part);
    if (has_shading) ordered.push_back(t);
  }
  if (!has_shading) return EncodeVoxel(voxel, nullptr);
  const ShadingVoxel shading = BuildShading(ordered);
  return EncodeVoxel(voxel, &shading);
}

}  // namespace quarry

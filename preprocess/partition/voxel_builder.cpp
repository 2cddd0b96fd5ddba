#include "preprocess/partition/voxel_builder.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "common/kdtree/build/prune.h"
#include "common/kdtree/build/treelets.h"
#include "common/kdtree/build/wide_tree.h"
#include "common/math/packed_normal.h"
#include "preprocess/partition/interner.h"

namespace quarry {
namespace {

ShadingVertex Sanitized(ShadingVertex v) {
  if (!IsNormal(v.normal)) v.normal = glm::vec3(0);
  if (!std::isfinite(v.uv.x) || !std::isfinite(v.uv.y)) v.uv = glm::vec2(0);
  return v;
}

/// Whether packing keeps a normal bit by bit.
bool SurvivesPacking(const glm::vec3& n) {
  const glm::vec3 kept = IsNormal(n) ? UnpackNormal(PackNormal(n)) : glm::vec3(0);
  // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison): -0 is not 0.
  return std::memcmp(&kept, &n, sizeof n) == 0;
}

/// The facet's normal at the corners of a smoothed triangle that keep it, if others differ from it: shading
/// takes the mean of the three.
TriangleRecord WithAllNormals(TriangleRecord t) {
  if (!IsSmoothed(t) || std::ranges::none_of(t.normals, IsNormal)) return t;
  const glm::vec3 facet = UnpackNormal(PackNormal(FacetNormal(t)));
  for (glm::vec3& n : t.normals)
    if (!IsNormal(n)) n = facet;
  return t;
}

ShadingVoxel BuildShading(std::span<const TriangleRecord> triangles, bool may_pack) {
  ShadingVoxel voxel;
  voxel.corners.reserve(triangles.size() * 3);
  Interner<ShadingVertex> interner(triangles.size() * 3);
  for (const TriangleRecord& t : triangles)
    for (int k = 0; k < 3; ++k)
      voxel.corners.push_back(
          interner.Index(Sanitized({t.normals[k], t.uvs[k], t.colors[k]}), voxel.vertices));
  voxel.packed = may_pack && std::ranges::all_of(voxel.vertices, SurvivesPacking, &ShadingVertex::normal);
  return voxel;
}

/// Whether a voxel has a shading block: the model has attributes, or a triangle has a normal.
bool HasShading(std::span<const TriangleRecord> triangles, const ShadingOptions& options) {
  return options.attributes ||
         (options.smoothed && std::ranges::any_of(triangles, [](const TriangleRecord& t) {
            return std::ranges::any_of(t.normals, IsNormal);
          }));
}

}  // namespace

uint32_t MaxTrianglesPerVoxel(uint32_t voxel_size, bool masks) {
  const size_t fixed = kTreeletHeaderSlots * sizeof(KdNode) + HotBytes(1, 0, 0, 0);
  const size_t each = HotBytes(1, 1, 1, 3, masks ? 1 : 0) - HotBytes(1, 0, 0, 0);
  return static_cast<uint32_t>(
      std::clamp<size_t>((voxel_size - std::min<size_t>(voxel_size, fixed)) / each, 1, kMaxVoxelTriangles));
}

namespace {

constexpr uint16_t kUnseen = 0xFFFF;
// SAH steps that a byte is worth, and the extra cost of a triangle in both children. Both save bytes and work
// for a hundredth of the SAH cost (tests/bench/history/preprocess.md, 2026-11-29).
constexpr float kByteWorth = 0.01f;
constexpr float kCopyCost = 0.1f;
// Most bytes of fine masks: a part of the voxel, and of what its triangles leave, since the tree comes first.
constexpr size_t kFineMaskShare = 8, kSpareShare = 4;

struct VoxelTree {
  KdTree tree;
  uint32_t node_slots, wide_nodes;
};

/// The tree over `triangles` whose layout takes at most `room` bytes with wide nodes, and without them no
/// more than the voxel's `others` bytes.
VoxelTree BuildTree(const VoxelTask& task, float padding, size_t room, size_t others) {
  const Box& cell = task.cell;
  std::vector<KdTriangle> vertices;
  vertices.reserve(task.triangles.size());
  for (const TriangleRecord& t : task.triangles)
    vertices.push_back({{t.vertices[0], t.vertices[1], t.vertices[2]}});
  const SahCosts costs{.duplicate = kCopyCost, .byte = kByteWorth};
  // Headers and wide nodes take about 7/9 of the tree's own bytes; only the layout gives the exact size.
  KdTree tree = BuildKdTree(vertices, padding, cell, costs, room, task.references);
  for (size_t most_bytes = room / 16 * 9;;) {
    PruneKdTree(tree, cell, costs, most_bytes);
    const size_t slots = TreeletLayout(kTreeletLevels).Slots(tree.nodes);
    const size_t wide_nodes =
        MakeWideTree(tree.nodes, cell, kWideLeafReferences, [](const KdNode&, const Box& box) {
          return box;
        }).size();
    const size_t of_nodes = slots * sizeof(KdNode);
    const size_t kept = HotBytes(wide_nodes, tree.references.size(), 0, 0), taken = of_nodes + kept;
    if ((taken <= room && of_nodes <= kept + others) || slots == kTreeletHeaderSlots)
      return {std::move(tree), static_cast<uint32_t>(slots), static_cast<uint32_t>(wide_nodes)};
    const size_t bytes = tree.nodes.size() * sizeof(KdNode) + tree.references.size() * 2;
    most_bytes = bytes * std::min(room, taken) / taken - bytes / 128;
  }
}

/// The first reference of each leaf, and the end of the last.
std::vector<uint32_t> LeafBounds(const KdTree& tree) {
  std::vector<uint32_t> bounds{static_cast<uint32_t>(tree.references.size())};
  for (const KdNode& n : tree.nodes)
    if (n.is_leaf() && n.count() != 0) bounds.push_back(n.first());
  std::ranges::sort(bounds);
  return bounds;
}

/// Orders triangles by the leaf that first refers to them and renumbers the references, so that a leaf's
/// triangles lie together. Each leaf refers to earlier triangles first, in order, then to its own: long runs
/// that are small and quick to decode. Returns each triangle's new number.
std::vector<uint16_t> OrderByLeaves(KdTree& tree, size_t triangles) {
  std::vector<uint16_t> number(triangles, kUnseen), order;
  order.reserve(triangles);
  const std::vector<uint32_t> bounds = LeafBounds(tree);
  for (size_t i = 0; i + 1 < bounds.size(); ++i) {
    const auto first = tree.references.begin() + bounds[i], end = tree.references.begin() + bounds[i + 1];
    const auto fresh = std::stable_partition(first, end, [&](uint32_t t) { return number[t] != kUnseen; });
    for (auto reference = fresh; reference != end; ++reference) {
      number[*reference] = static_cast<uint16_t>(order.size());
      order.push_back(static_cast<uint16_t>(*reference));
    }
    std::transform(first, end, first, [&](uint32_t t) { return number[t]; });
    std::sort(first, fresh);
  }
  // The partition assigns a triangle by its box; the tree may find that it does not reach the cell.
  for (size_t t = 0; t < triangles; ++t)
    if (number[t] == kUnseen) order.push_back(static_cast<uint16_t>(t));
  return order;
}

}  // namespace

EncodedVoxel BuildVoxel(const VoxelTask& task, float padding, const ShadingOptions& options,
                        uint32_t voxel_size, const TriangleMasks* masks) {
  const std::span<const TriangleRecord> triangles = task.triangles;
  const bool has_shading = HasShading(triangles, options);
  Interner<glm::vec3> interner(triangles.size() * 3);
  std::vector<glm::vec3> vertices;
  vertices.reserve(triangles.size());
  std::vector<uint16_t> corners;
  corners.reserve(triangles.size() * 3);
  for (const TriangleRecord& t : triangles)
    for (const glm::vec3& v : t.vertices) corners.push_back(interner.Index(v, vertices));
  const bool has_masks = masks != nullptr && std::ranges::any_of(triangles, [&](const TriangleRecord& t) {
                           return masks->is_mapped(t.material);
                         });
  const size_t triangles_with_mask = has_masks ? triangles.size() : 0;
  const auto left_by = [&](size_t bytes) { return voxel_size > bytes ? voxel_size - bytes : 0; };
  VoxelMasks found;
  if (has_masks) {
    const size_t least = kTreeletHeaderSlots * sizeof(KdNode) +  // of a tree that is a single leaf
                         HotBytes(1, triangles.size(), triangles.size(), vertices.size(), triangles.size());
    const size_t spare = left_by(least);
    found = FindMasks(triangles, *masks,
                      std::min(voxel_size / kFineMaskShare, spare / kSpareShare) / sizeof(FineMask));
  }
  const size_t without_tree =
      HotBytes(0, 0, triangles.size(), vertices.size(), triangles_with_mask, found.fine.size());
  const size_t room = left_by(without_tree);

  HotVoxel voxel;
  voxel.cell = task.cell;
  auto [tree, node_slots, wide_nodes] = BuildTree(task, padding, room, without_tree);
  const std::vector<uint16_t> order = OrderByLeaves(tree, triangles.size());
  voxel.nodes = std::move(tree.nodes);
  voxel.node_slots = node_slots;
  voxel.wide_nodes = wide_nodes;
  voxel.references.assign(tree.references.begin(), tree.references.end());
  std::vector<TriangleRecord> ordered;
  if (has_shading) ordered.reserve(order.size());
  std::vector<uint16_t> number(vertices.size(), kUnseen);  // of each vertex, in the order of the triangles
  voxel.vertices.reserve(vertices.size());
  voxel.corners.reserve(corners.size());
  voxel.triangle_ids.reserve(triangles.size());
  voxel.materials.reserve(triangles.size());
  voxel.parts.reserve(triangles.size());
  voxel.fine_masks = std::move(found.fine);
  for (uint16_t i : order) {
    const TriangleRecord& t = triangles[i];
    for (size_t k = 0; k < 3; ++k) {
      const uint16_t vertex = corners[3 * size_t{i} + k];
      if (number[vertex] == kUnseen) {
        number[vertex] = static_cast<uint16_t>(voxel.vertices.size());
        voxel.vertices.push_back(vertices[vertex]);
      }
      voxel.corners.push_back(number[vertex]);
    }
    voxel.triangle_ids.push_back(t.id);
    voxel.materials.push_back(static_cast<uint16_t>(t.material));
    voxel.parts.push_back(t.part);
    if (has_masks) voxel.masks.push_back(found.masks[i]);
    if (has_shading) ordered.push_back(options.smoothed ? WithAllNormals(t) : t);
  }
  if (!has_shading) return EncodeVoxel(voxel, nullptr);
  const ShadingVoxel shading = BuildShading(ordered, options.smoothed);
  return EncodeVoxel(voxel, &shading);
}

}  // namespace quarry

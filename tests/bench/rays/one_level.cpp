#include "tests/bench/rays/one_level.h"

#include <hwy/targets.h>

#include <algorithm>
#include <unordered_map>

#include "common/kdtree/build/treelets.h"
#include "common/kdtree/build/wide_tree.h"
#include "tests/bench/rays/one_level_kernels.h"

namespace quarry::bench {

OneLevelScene::OneLevelScene(const test::ResidentScene& scene) {
  const SceneMeta& meta = scene.catalog().meta;
  std::vector<bool> seen(meta.input_triangles);
  std::vector<KdTriangle> triangles;
  std::vector<uint32_t> ids;
  for (const VoxelGeometry& v : scene.voxels())
    for (uint32_t t = 0; t < v.triangle_count; ++t) {
      if (seen[v.triangle_ids[t]]) continue;
      seen[v.triangle_ids[t]] = true;
      triangles.push_back({{v.vertex(t, 0), v.vertex(t, 1), v.vertex(t, 2)}});
      ids.push_back(v.triangle_ids[t]);
    }
  const Box box{meta.root_lower, meta.root_upper};
  KdTree tree = BuildKdTree(triangles, meta.padding, box, SahCosts{}, ~size_t{0} / 2);
  nodes_ = LayOutTreelets(tree.nodes, kTreeletLevels, box);
  // Triangles in the order of leaves, vertices shared within runs, as voxels have them.
  std::vector<uint32_t> number(triangles.size(), kNoTriangle);
  std::unordered_map<uint64_t, std::vector<uint32_t>> known;
  const auto vertex = [&](const glm::vec3& p) {
    const auto* words = reinterpret_cast<const uint32_t*>(&p);
    const uint64_t key = (words[0] * 0x9E3779B97F4A7C15ull ^ words[1]) * 0x9E3779B97F4A7C15ull ^ words[2];
    for (uint32_t i : known[key])
      if (vertices_[i] == p) return i;
    vertices_.push_back(p);
    known[key].push_back(static_cast<uint32_t>(vertices_.size() - 1));
    return static_cast<uint32_t>(vertices_.size() - 1);
  };
  for (uint32_t& reference : tree.references) {
    uint32_t& n = number[reference];
    if (n == kNoTriangle) {
      n = static_cast<uint32_t>(ids_.size());
      ids_.push_back(ids[reference]);
      for (const glm::vec3& p : triangles[reference].vertices) corners_.push_back(vertex(p));
    }
    reference = n;
  }
  references_ = std::move(tree.references);
  vertices_.push_back({});  // each may be read as four floats
  geometry_.nodes = nodes_.data();
  geometry_.references = references_.data();
  geometry_.corners = corners_.data();
  geometry_.vertices = vertices_.data();
  geometry_.triangle_ids = ids_.data();
  top_ = LayOutTreelets(std::vector{KdNode::Leaf(0, 1)}, kTreeletLevels, box);
  static constexpr uint32_t kEnd[] = {kNoVoxel};
  geometry_.node_count = static_cast<uint32_t>(nodes_.size());
  wide_ = MakeWideTree(nodes_, box, kWideLeafReferences, [&](const KdNode& leaf, const Box& cell) {
    if (leaf.count() == 0) return cell;
    Box around{vertices_[corners_[3 * references_[leaf.first()]]],
               vertices_[corners_[3 * references_[leaf.first()]]]};
    for (uint32_t r = leaf.first(); r < leaf.first() + leaf.count(); ++r)
      for (uint32_t k = 0; k < 3; ++k) around.Include(vertices_[corners_[3 * references_[r] + k]]);
    for (int a = 0; a < 3; ++a) {
      around.lower[a] = std::max(around.lower[a] - meta.padding, cell.lower[a]);
      around.upper[a] = std::min(around.upper[a] + meta.padding, cell.upper[a]);
    }
    return around;
  });
  geometry_.wide = wide_.data();
  top_wide_ = MakeWideTree(top_, box, 0, [](const KdNode&, const Box& cell) { return cell; });
  bounds_ = {{meta.root_lower.x, meta.root_lower.y, meta.root_lower.z},
             {meta.root_upper.x, meta.root_upper.y, meta.root_upper.z}};
  tree_ = {top_.data(), kEnd, &bounds_, meta.root_lower, meta.root_upper, top_wide_.data()};
}

void OneLevelScene::Trace(RayPacket* packets, const uint64_t* active, uint32_t count, Grouping grouping,
                          bool any) const {
  const Finder32 finder{
      [](void* context, uint32_t) { return static_cast<const VoxelGeometryOf<uint32_t>*>(context); },
      const_cast<VoxelGeometryOf<uint32_t>*>(&geometry_)};
  const bool wide = (hwy::SupportedTargets() & HWY_AVX3) != 0;
  (wide ? TraceOneLevelAvx512 : TraceOneLevelAvx2)(tree_, finder, packets, active, count, grouping, any);
}

}  // namespace quarry::bench

#include "tests/laboratory/structures/store_tree.h"

#include <algorithm>

#include "common/voxel/block_decoder.h"
#include "tests/support/rendering/flat_tree.h"

namespace quarry::laboratory {
namespace {

constexpr float kVoxelByteWorth = 0.01f;  // as preprocess/partition/voxel_builder.cpp

/// Puts trees together.
class Stitcher {
 public:
  explicit Stitcher(const LaboratoryScene& scene) : scene_(scene), catalog_(scene.catalog()) {}

  Result<KdTree> Run() {
    tree_.nodes = test::FlattenTreelets(catalog_.top_nodes);
    const size_t top = tree_.nodes.size();
    std::vector<Box> cells(top);
    cells[0] = scene_.box();
    for (size_t i = 0; i < top; ++i) {
      const KdNode node = tree_.nodes[i];
      if (node.is_leaf()) {
        if (node.count() != 0) QUARRY_TRY(Replace(i, cells[i]));
        continue;
      }
      Box &left = cells[node.left()], &right = cells[node.left() + 1];
      left = right = cells[i];
      left.upper[node.axis()] = right.lower[node.axis()] = node.split();
    }
    return std::move(tree_);
  }

 private:
  /// Puts the trees of a top-level leaf's voxels into its place.
  Status Replace(size_t at, const Box& cell) {
    const uint32_t first = tree_.nodes[at].first(), end = catalog_.chain_end[first];
    if (end - first == 1) {
      QUARRY_TRY(Decode(first));
      std::vector<uint32_t> places;
      for (uint32_t r = 0; r < voxel_.reference_count; ++r)
        places.push_back(scene_.PlaceOf(voxel_.triangle_ids[voxel_.references[r]]));
      Put(at, test::FlattenTreelets(nodes_), places);
      return {};
    }
    std::vector<uint32_t> places;
    for (uint32_t voxel = first; voxel < end; ++voxel) {
      QUARRY_TRY(Decode(voxel));
      for (uint32_t t = 0; t < voxel_.triangle_count; ++t)
        places.push_back(scene_.PlaceOf(voxel_.triangle_ids[t]));
    }
    std::ranges::sort(places);
    places.erase(std::unique(places.begin(), places.end()), places.end());
    std::vector<KdTriangle> triangles;
    for (const uint32_t place : places) triangles.push_back(scene_.triangles()[place]);
    KdTree chain = BuildKdTree(triangles, scene_.padding(), cell, {.byte = kVoxelByteWorth}, ~size_t{0} / 2);
    for (uint32_t& reference : chain.references) reference = places[reference];
    Put(at, chain.nodes, chain.references);
    return {};
  }

  /// Puts a tree into the place of the node `at`.
  void Put(size_t at, const std::vector<KdNode>& nodes, const std::vector<uint32_t>& references) {
    const auto first = static_cast<uint32_t>(tree_.references.size());
    // The root takes the leaf's place; all others follow behind.
    const auto behind = static_cast<uint32_t>(tree_.nodes.size()) - 1;
    const auto moved = [&](const KdNode& node) {
      return node.is_leaf() ? KdNode::Leaf(first + node.first(), node.count())
                            : KdNode::Inner(node.axis(), node.split(), behind + node.left());
    };
    tree_.nodes[at] = moved(nodes[0]);
    for (size_t i = 1; i < nodes.size(); ++i) tree_.nodes.push_back(moved(nodes[i]));
    tree_.references.insert(tree_.references.end(), references.begin(), references.end());
  }

  Status Decode(uint32_t voxel) {
    const BlockKey key = BlockKey::Hot(voxel);
    QUARRY_ASSIGN(const Bytes stored, scene_.store().ReadBlock(key));
    nodes_.clear();
    QUARRY_ASSIGN(voxel_, DecodeHot(decoder_, catalog_, voxel, stored,
                                    memory_.Fit(catalog_.block(key).decoded), &nodes_));
    return {};
  }

  const LaboratoryScene& scene_;
  const Catalog& catalog_;
  KdTree tree_;
  BlockDecoder decoder_;
  BlockMemory memory_;
  VoxelGeometry voxel_;
  std::vector<KdNode> nodes_;
};

}  // namespace

Result<KdTree> ReadStoreTree(const LaboratoryScene& scene) { return Stitcher(scene).Run(); }

}  // namespace quarry::laboratory

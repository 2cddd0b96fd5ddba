#include "tests/laboratory/store_tree.h"

#include <algorithm>

#include "common/voxel/block_decoder.h"
#include "tests/support/flat_tree.h"

namespace quarry::laboratory {
namespace {

/// Puts trees together.
class Stitcher {
 public:
  explicit Stitcher(const LaboratoryScene& scene) : scene_(scene), catalog_(scene.catalog()) {}

  Result<KdTree> Run() {
    tree_.nodes = test::FlattenTreelets(catalog_.top_nodes);
    const size_t top = tree_.nodes.size();
    for (size_t i = 0; i < top; ++i)
      if (tree_.nodes[i].is_leaf() && tree_.nodes[i].count() != 0) QUARRY_TRY(Replace(i));
    return std::move(tree_);
  }

 private:
  /// Puts the trees of a top-level leaf's voxels into its place.
  Status Replace(size_t at) {
    const uint32_t first = tree_.nodes[at].first(), end = catalog_.chain_end[first];
    QUARRY_TRY(Decode(first));
    if (end - first == 1) {
      PutVoxel(at);
      return {};
    }
    std::vector<uint32_t> places;
    for (uint32_t voxel = first; voxel < end; ++voxel) {
      if (voxel != first) QUARRY_TRY(Decode(voxel));
      for (uint32_t t = 0; t < voxel_.triangle_count; ++t)
        places.push_back(scene_.PlaceOf(voxel_.triangle_ids[t]));
    }
    std::ranges::sort(places);
    places.erase(std::ranges::unique(places).begin(), places.end());
    const auto begin = static_cast<uint32_t>(tree_.references.size());
    tree_.references.insert(tree_.references.end(), places.begin(), places.end());
    tree_.nodes[at] = KdNode::Leaf(begin, static_cast<uint32_t>(places.size()));
    return {};
  }

  /// Puts the decoded voxel's tree into the place of the node `at`.
  void PutVoxel(size_t at) {
    const std::vector<KdNode> nodes = test::FlattenTreelets(nodes_);
    const auto references = static_cast<uint32_t>(tree_.references.size());
    // The root takes the leaf's place; all others follow behind.
    const auto behind = static_cast<uint32_t>(tree_.nodes.size()) - 1;
    const auto moved = [&](const KdNode& node) {
      return node.is_leaf() ? KdNode::Leaf(references + node.first(), node.count())
                            : KdNode::Inner(node.axis(), node.split(), behind + node.left());
    };
    tree_.nodes[at] = moved(nodes[0]);
    for (size_t i = 1; i < nodes.size(); ++i) tree_.nodes.push_back(moved(nodes[i]));
    for (uint32_t r = 0; r < voxel_.reference_count; ++r)
      tree_.references.push_back(scene_.PlaceOf(voxel_.triangle_ids[voxel_.references[r]]));
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

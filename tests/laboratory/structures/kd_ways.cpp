#include "tests/laboratory/structures/kd_ways.h"

#include "tests/support/rendering/ropes.h"

namespace quarry::laboratory {

KdRopes::KdRopes(const KdTree& tree, const Box& box, AddressSpace& addresses) : list_data_(tree.references) {
  box_ = box;
  const std::vector<KdNode> roped = MakeRopes(tree.nodes, box);
  node_data_.assign(roped.begin(), roped.begin() + static_cast<std::ptrdiff_t>(tree.nodes.size()));
  for (KdNode& node : node_data_) {
    if (!node.is_leaf()) continue;
    leaf_data_.push_back(RopeLeafAt(roped.data(), node.first()));
    node.payload = static_cast<uint32_t>(leaf_data_.size() - 1);
  }
  nodes_ = addresses.TextureOf(node_data_, DataKind::kCells);
  leaves_ = addresses.TextureOf(leaf_data_, DataKind::kCells);
  list_ = addresses.TextureOf(list_data_, DataKind::kLists);
}

}  // namespace quarry::laboratory

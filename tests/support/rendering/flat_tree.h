#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/kdtree/node.h"

namespace quarry::test {

/// The tree without treelets: root first, children side by side, no flags.
inline std::vector<KdNode> FlattenTreelets(std::span<const KdNode> nodes) {
  const auto plain = [](KdNode node) {
    node.link &= ~KdNode::kFlags;
    return node;
  };
  std::vector<KdNode> out{plain(nodes[0])};
  std::vector<uint32_t> source{0};
  for (size_t i = 0; i < out.size(); ++i) {
    if (out[i].is_leaf()) continue;
    const uint32_t left = nodes[source[i]].left();
    const auto pair = static_cast<uint32_t>(out.size());
    out[i] = KdNode::Inner(out[i].axis(), out[i].split(), pair);
    for (uint32_t side = 0; side < 2; ++side) {
      out.push_back(plain(nodes[left + side]));
      source.push_back(left + side);
    }
  }
  return out;
}

}  // namespace quarry::test

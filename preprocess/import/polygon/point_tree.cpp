#include "preprocess/import/polygon/point_tree.h"

#include <algorithm>
#include <numeric>
#include <tuple>

namespace quarry {

void PointTree::Build(std::span<const glm::vec2> points) {
  order_.resize(points.size());
  std::iota(order_.begin(), order_.end(), 0u);
  leaf_of_.resize(points.size());
  marked_.assign(points.size(), 0);
  nodes_.clear();
  nodes_.push_back({{}, {}, 0, static_cast<uint32_t>(points.size())});
  for (uint32_t i = 0; i < nodes_.size(); ++i) Split(i, points);
}

void PointTree::Split(uint32_t at, std::span<const glm::vec2> points) {
  Node& node = nodes_[at];
  const auto first = order_.begin() + node.first, end = order_.begin() + node.end;
  if (first == end) return;
  node.lower = node.upper = points[*first];
  for (auto i = first; i != end; ++i) {
    node.lower = glm::vec2(std::min(node.lower.x, points[*i].x), std::min(node.lower.y, points[*i].y));
    node.upper = glm::vec2(std::max(node.upper.x, points[*i].x), std::max(node.upper.y, points[*i].y));
  }
  if (node.end - node.first <= kLeafPoints) {
    for (auto i = first; i != end; ++i) leaf_of_[*i] = at;
    return;
  }
  const int axis = node.upper.x - node.lower.x < node.upper.y - node.lower.y;
  const uint32_t middle = (node.first + node.end) / 2;
  std::nth_element(first, order_.begin() + middle, end, [&](uint32_t a, uint32_t b) {
    return std::tuple(points[a][axis], a) < std::tuple(points[b][axis], b);
  });
  node.left = static_cast<uint32_t>(nodes_.size());
  const Node halves[] = {{{}, {}, node.first, middle, 0, at}, {{}, {}, middle, node.end, 0, at}};
  nodes_.insert(nodes_.end(), std::begin(halves), std::end(halves));  // `node` may dangle from here on
}

void PointTree::Mark(uint32_t point, bool mark) {
  if (marked(point) == mark) return;
  marked_[point] = mark;
  for (uint32_t i = leaf_of_[point];; i = nodes_[i].parent) {
    nodes_[i].marked += mark ? 1 : -1u;
    if (i == 0) return;
  }
}

}  // namespace quarry

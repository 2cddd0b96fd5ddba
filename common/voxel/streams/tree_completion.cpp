#include "common/voxel/streams/tree_completion.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <cstring>

#include "common/kdtree/treelet_header.h"

namespace quarry {
namespace {

/// Writes the cell of a treelet's root into the treelet's header.
void PutCell(const Box8& cell, KdNode* header) {
  const Float4 lower = cell.lower(), upper = cell.upper();
  auto* bytes = reinterpret_cast<std::byte*>(header);
  std::memcpy(bytes + offsetof(TreeletHeader, lower), &lower, sizeof TreeletHeader::lower);
  std::memcpy(bytes + offsetof(TreeletHeader, upper), &upper, sizeof TreeletHeader::upper);
}

}  // namespace

void TreeCompletion::FillBoxes(const VoxelGeometry& v) {
  if (boxes_.size() < v.triangle_count) boxes_.resize(v.triangle_count);
  const uint16_t* corner = v.corners;
  for (uint32_t t = 0; t < v.triangle_count; ++t, corner += 3)
    boxes_[t] = BoxOf(v.vertices[corner[0]], v.vertices[corner[1]], v.vertices[corner[2]]);
}

/// Descends from `visit` to its leftmost leaf.
inline TreeCompletion::Visit TreeCompletion::GoDown(Visit visit, std::span<KdNode> slots) {
  KdNode no_header[kTreeletHeaderSlots];
  for (;;) {
    const KdNode n = slots[visit.node];
    if (n.is_leaf()) return visit;
    // Writes to a dummy header rather than branch: the branch would be unpredictable.
    PutCell(visit.cell, n.begins_treelet() ? &slots[n.left() - kTreeletHeaderSlots] : no_header);
    axes_.resize(visit.level);
    axes_.push_back(static_cast<uint8_t>(n.axis()));
    ++visit.level;
    right_.push_back({visit.cell.WithLower(n.axis(), n.split()), n.left() + 1, visit.level});
    visit.cell = visit.cell.WithUpper(n.axis(), n.split());
    visit.node = n.left();
  }
}

inline Box8 TreeCompletion::BoxOfLeaf(const uint16_t* references, uint32_t count) const {
  Box8 box = boxes_[references[0]];
  for (uint32_t r = 1; r < count; ++r) box.Include(boxes_[references[r]]);
  return box;
}

Status TreeCompletion::Run(const VoxelGeometry& v, const Box& cell, float padding, std::span<KdNode> slots,
                           std::span<WideNode> wide) {
  FillBoxes(v);
  wide_.Begin(wide);
  right_.clear();
  right_.push_back({Box8::Of(cell), 0, 0});
  uint32_t references = 0;
  uint32_t deepest = 0;
  while (!right_.empty()) {
    const Visit next = right_.back();
    right_.pop_back();
    const Visit leaf = GoDown(next, slots);
    deepest = std::max(deepest, leaf.level);
    KdNode& node = slots[leaf.node];
    const uint32_t count = node.count();
    if (count != 0) {
      node.payload = references;
      wide_.Leaf(BoxOfLeaf(v.references + references, count).Grown(padding).Within(leaf.cell), references,
                 count);
      references += count;
    } else {
      wide_.Leaf(leaf.cell, 0, 0);
    }
    // Closes the inner nodes whose subtrees are complete: all below the parent of the next visit.
    const uint32_t next_level = right_.empty() ? 0 : right_.back().level;
    for (uint32_t level = leaf.level; level > next_level; --level) wide_.Join(axes_[level - 1]);
  }
  if (deepest > kMostLevels)
    return Fail(fmt::format("voxel block: its tree has more than {} levels", kMostLevels));
  if (wide_.Finish() != wide.size()) return Fail("voxel block: not as many wide nodes as its tree has");
  return {};
}

}  // namespace quarry

#include "preprocess/partition/regions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <future>
#include <utility>

#include "common/kdtree/build/clipped_triangle.h"
#include "common/kdtree/build/reference_stacks.h"

namespace quarry {
namespace {

constexpr uint64_t kRoutedAtOnce = 64 << 10;
// Triangles reach a little beyond the sampled ones, so planes are not placed at sampled box ends.
constexpr SahCosts kSampleCosts{.duplicate = kPartitionCosts.duplicate, .sampled = true};

class RegionChooser {
 public:
  RegionChooser(const std::vector<KdTriangle>& sample, uint64_t weight, float padding, const Region& whole)
      : splitter_(sample, padding, whole.cell, weight == 1 ? kPartitionCosts : kSampleCosts),
        weight_(weight) {
    Split(0, stacks_.Start(splitter_.ReferencesIn(whole.cell)), whole);
  }

  RegionTree tree{{KdNode{}}, {}, {}};

 private:
  /// Splits a node, and removes its references.
  void Split(uint32_t node, ReferenceRange range, const Region& region) {
    const std::span<const KdReference> references = stacks_.Of(range);
    const SplitPlane plane = references.size() * weight_ <= kRegionTriangles
                                 ? SplitPlane{}
                                 : ChoosePlane(splitter_, references, region.cell);
    if (EndsInChain(plane, region.depth, region.growth, MaxGrowthOfRegions(region.share))) {
      tree.nodes[node] = KdNode::Leaf(static_cast<uint32_t>(tree.regions.size()), 1);
      tree.regions.push_back(region);
      tree.leaves.push_back(node);
      stacks_.Drop(range);
      return;
    }
    const SplitCells child(region.cell, plane);
    const auto first = static_cast<uint32_t>(tree.nodes.size());
    tree.nodes[node] = KdNode::Inner(plane.axis, plane.position, first);
    tree.nodes.resize(first + 2);
    const size_t count = references.size();
    const auto [left, right] = splitter_.Divide(stacks_, range, region.cell, {0, plane.position, plane.axis});
    const double growth = region.growth * plane.growth;
    const auto share = [&](ReferenceRange child_range) {
      return region.share * static_cast<double>(stacks_.Of(child_range).size()) / static_cast<double>(count);
    };
    const double of_right = share(right);
    Split(first, left, {child.cell[0], region.depth + 1, growth, share(left)});
    Split(first + 1, right, {child.cell[1], region.depth + 1, growth, of_right});
  }

  KdSplitter splitter_;
  const uint64_t weight_;
  ReferenceStacks stacks_;
};

}  // namespace

RegionTree ChooseRegions(const std::vector<KdTriangle>& sample, uint64_t weight, float padding,
                         const Region& whole) {
  return std::move(RegionChooser(sample, weight, padding, whole).tree);
}

void CutOffEmptySpace(const std::vector<Box>& contents, const Box& whole, RegionTree& tree) {
  const std::vector<KdNode> before = std::exchange(tree.nodes, {KdNode{}});
  // Children lie beyond their parents.
  std::vector<Box> content(before.size(), EmptyBox());
  for (size_t i = before.size(); i-- > 0;) {
    const KdNode& n = before[i];
    if (n.is_leaf()) {
      if (n.count() != 0) content[i] = contents[n.first()];
      continue;
    }
    for (const Box& side : {content[n.left()], content[n.left() + 1]}) {
      if (!(side.lower.x <= side.upper.x)) continue;
      content[i].Include(side.lower);
      content[i].Include(side.upper);
    }
  }
  struct Visit {
    uint32_t from, to;
    Box cell;
  };
  std::vector<Visit> visits{{0, 0, whole}};
  while (!visits.empty()) {
    Visit v = visits.back();
    visits.pop_back();
    const KdNode& n = before[v.from];
    if (content[v.from].lower.x <= content[v.from].upper.x)
      v.to = CutOffEmptySpace(tree.nodes, v.to, v.cell, content[v.from]);
    if (n.is_leaf()) {
      tree.nodes[v.to] = n;
      tree.leaves[n.first()] = v.to;
      tree.regions[n.first()].cell = v.cell;
      continue;
    }
    const auto first = static_cast<uint32_t>(tree.nodes.size());
    tree.nodes[v.to] = KdNode::Inner(n.axis(), n.split(), first);
    tree.nodes.resize(first + 2);
    const SplitCells child(v.cell, {n.axis(), n.split()});
    visits.push_back({n.left() + 1, first + 1, child.cell[1]});
    visits.push_back({n.left(), first, child.cell[0]});
  }
}

Result<RegionFiles> RegionFiles::Open(const RegionTree& tree, const std::string& prefix, size_t record_bytes,
                                      uint64_t memory, size_t gone, const std::vector<uint64_t>& counts,
                                      const std::vector<Box>& contents) {
  const size_t regions = tree.regions.size();
  const bool large = regions * kRegionTriangles * record_bytes >= SpillFile::kPackLarge;
  QUARRY_ASSIGN(SpillFiles spill,
                SpillFiles::Open(prefix, regions, record_bytes,
                                 {memory, large ? SpillFile::kPackAll : SpillFile::kPackNone, gone, counts}));
  RegionFiles files(tree, std::move(spill));
  files.contents_ = contents.empty() ? std::vector<Box>(regions, EmptyBox()) : contents;
  return files;
}

RegionFiles::Routed RegionFiles::Route(const SpillFile& triangles, uint64_t first, uint64_t count,
                                       float padding) {
  Routed routed;
  const size_t size = triangles.element_bytes();
  routed.count = count;
  routed.records = std::make_unique_for_overwrite<std::byte[]>(count * size);
  routed.status = triangles.Read(first, {routed.records.get(), count * size});
  if (!routed.status) return routed;
  routed.places.reserve(count + count / 4);
  TriangleRecord record;
  for (uint32_t i = 0; i < count; ++i) {
    CopyRecord(&routed.records[i * size], size, record);
    ForEachRegion(*tree_, record, padding, [&](uint32_t region, const Box& part) {
      contents_[region].IncludeBox(part);
      routed.places.push_back({region, i});
    });
  }
  return routed;
}

Status RegionFiles::Add(const SpillFile& triangles, uint64_t first, uint64_t last, float padding,
                        const std::function<void(uint64_t)>& progress) {
  const auto route = [&, padding](uint64_t from) {
    const uint64_t count = std::min(kRoutedAtOnce, last - from);
    return std::async(std::launch::async,
                      [=, this, &triangles] { return Route(triangles, from, count, padding); });
  };
  if (first >= last) return {};
  std::future<Routed> next = route(first);
  while (first < last) {
    const Routed routed = next.get();
    QUARRY_TRY(routed.status);
    first += routed.count;
    if (first < last) next = route(first);
    for (const auto& [region, record] : routed.places)
      QUARRY_TRY(files_.Append(region, &routed.records[record * triangles.element_bytes()]));
    progress(first);
  }
  return {};
}

std::optional<Box> PartIn(const TriangleRecord& triangle, const Box& box, const Box& cell, float padding) {
  const Box inner{glm::max(box.lower, cell.lower), glm::min(box.upper, cell.upper)};
  if (inner.lower == box.lower && inner.upper == box.upper) return box;
  // As KdSplitter cuts: the padding and the largest rounding error.
  const double growth = padding * 1.125;
  const KdTriangle whole{{triangle.vertices[0], triangle.vertices[1], triangle.vertices[2]}};
  ClippedTriangle polygon(whole);
  polygon.Clip(cell, growth);
  if (polygon.empty()) return {};
  const PointBox bounds = polygon.Bounds();
  Box part;
  for (int a = 0; a < 3; ++a) {
    part.lower[a] = std::max(inner.lower[a], static_cast<float>(bounds.lower[a] - growth));
    part.upper[a] = std::min(inner.upper[a], static_cast<float>(bounds.upper[a] + growth));
    if (!(part.lower[a] <= part.upper[a])) return {};
  }
  return part;
}

}  // namespace quarry

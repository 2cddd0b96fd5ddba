#include "preprocess/partition/partition.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/kdtree/build/reference_stacks.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/partition/voxel_chain.h"

namespace quarry {
namespace {

class Partitioner {
 public:
  Partitioner(const PartitionOptions& options, const std::function<Status(VoxelTask)>& emit)
      : options_(options),
        emit_(emit),
        max_triangles_(MaxTrianglesPerVoxel(options.voxel_size, options.masks)) {}

  Status InMemory(const std::vector<TriangleRecord>& records, const Region& region) {
    records_ = &records;
    std::vector<KdTriangle> triangles;
    triangles.reserve(records.size());
    for (const TriangleRecord& r : records)
      triangles.push_back({{r.vertices[0], r.vertices[1], r.vertices[2]}});
    KdSplitter splitter(triangles, options_.padding, region.cell, kPartitionCosts);
    splitter_ = &splitter;
    const ReferenceRange root = stacks_.Start(splitter.ReferencesIn(region.cell));
    max_growth_ = MaxGrowthInRegion(stacks_.Of(root).size(), max_triangles_);
    return Split(0, root, {region.cell, region.depth, 1});
  }

  /// Makes one voxel chain of a region too large for memory, from as many triangles at a time as fit, in file
  /// order.
  Status ChainFile(const SpillFile& file, const Region& region, const Box& content) {
    Box cell = region.cell;
    tree.nodes[CutOffEmptySpace(tree.nodes, 0, cell, content)] = KdNode::Leaf(tree.voxels, 1);
    for (uint64_t first = 0; first < file.count();) {
      const uint64_t last = std::min(first + kMostInMemory, file.count());
      QUARRY_ASSIGN(const std::vector<TriangleRecord> records, LoadRecords(file, first, last));
      std::vector<KdReference> references;
      for (uint32_t i = 0; i < records.size(); ++i) {
        const Box whole = records[i].PaddedBox(options_.padding);
        const Box box = PartIn(records[i], whole, cell, options_.padding).value_or(whole);
        references.push_back(
            {{box.lower.x, box.lower.y, box.lower.z}, i, {box.upper.x, box.upper.y, box.upper.z}, 0});
      }
      QUARRY_TRY(EmitChain(records, references, cell, last < file.count()));
      first = last;
    }
    return {};
  }

  TopSubtree tree;

 private:
  /// Splits a node, and removes its references.
  Status Split(uint32_t node, ReferenceRange range, const Region& region) {
    const std::span<const KdReference> references = stacks_.Of(range);
    const size_t count = references.size();
    if (count == 0) {
      tree.nodes[node] = KdNode::Leaf(0, 0);
      return {};
    }
    const SplitPlane plane =
        count <= max_triangles_ ? SplitPlane{} : ChoosePlane(*splitter_, references, region.cell);
    if (EndsInChain(plane, region.depth, region.growth, max_growth_)) return Chain(node, range, region.cell);

    const auto first = static_cast<uint32_t>(tree.nodes.size());
    tree.nodes[node] = KdNode::Inner(plane.axis, plane.position, first);
    tree.nodes.resize(first + 2);
    const SplitCells child(region.cell, plane);
    const auto [left, right] =
        splitter_->Divide(stacks_, range, region.cell, {0, plane.position, plane.axis});
    const double growth = region.growth * plane.growth;
    QUARRY_TRY(Split(first, left, {child.cell[0], region.depth + 1, growth}));
    return Split(first + 1, right, {child.cell[1], region.depth + 1, growth});
  }

  /// Makes a leaf: one voxel, or a chain if no plane splits it well.
  Status Chain(uint32_t node, ReferenceRange range, Box cell) {
    const std::span<KdReference> references = stacks_.Of(range);
    tree.nodes[CutOffEmptySpace(tree.nodes, node, cell, ContentOf(references, cell))] =
        KdNode::Leaf(tree.voxels, 1);
    QUARRY_TRY(EmitChain(*records_, references, cell, false));
    stacks_.Drop(range);
    return {};
  }

  /// Emits the voxels of a chain; with `more`, further voxels follow.
  Status EmitChain(const std::vector<TriangleRecord>& records, std::span<KdReference> leaf, const Box& cell,
                   bool more) {
    size_t first = 0;
    for (const size_t end : SplitIntoChain(leaf, cell, max_triangles_)) {
      VoxelTask task;
      task.cell = cell;
      task.chained = more || end < leaf.size();
      task.triangles.reserve(end - first);
      task.references.reserve(end - first);
      for (; first < end; ++first) {
        task.references.push_back(leaf[first]);
        task.references.back().triangle = static_cast<uint32_t>(task.triangles.size());
        task.triangles.push_back(records[leaf[first].triangle]);
      }
      QUARRY_TRY(Emit(std::move(task)));
    }
    return {};
  }

  Status Emit(VoxelTask task) {
    ++tree.voxels;
    return emit_(std::move(task));
  }

  const PartitionOptions& options_;
  const std::function<Status(VoxelTask)>& emit_;
  const uint32_t max_triangles_;
  double max_growth_ = 1;
  const std::vector<TriangleRecord>* records_ = nullptr;
  KdSplitter* splitter_ = nullptr;
  ReferenceStacks stacks_;
};

}  // namespace

Result<std::vector<TriangleRecord>> LoadRecords(const SpillFile& file, uint64_t first, uint64_t last) {
  std::vector<TriangleRecord> records;
  records.reserve(last - first);
  QUARRY_TRY(ForEachRecord(file, first, last, [&](const TriangleRecord& r) -> Status {
    records.push_back(r);
    return Status{};
  }));
  return records;
}

Result<TopSubtree> PartitionInMemory(const std::vector<TriangleRecord>& triangles, const Region& region,
                                     const PartitionOptions& options,
                                     const std::function<Status(VoxelTask)>& emit) {
  Partitioner partitioner(options, emit);
  QUARRY_TRY(partitioner.InMemory(triangles, region));
  return std::move(partitioner.tree);
}

Result<TopSubtree> PartitionFile(const SpillFile& triangles, const Region& region, const Box& content,
                                 const PartitionOptions& options,
                                 const std::function<Status(VoxelTask)>& emit) {
  if (triangles.count() <= kMostInMemory) {
    QUARRY_ASSIGN(const std::vector<TriangleRecord> records, LoadRecords(triangles, 0, triangles.count()));
    return PartitionInMemory(records, region, options, emit);
  }
  TriangleSample sample;
  QUARRY_TRY(ForEachRecord(triangles, 0, triangles.count(), [&](const TriangleRecord& r) -> Status {
    sample.Add(r);
    return Status{};
  }));
  const uint64_t weight = sample.weight();
  RegionTree parts = ChooseRegions(sample.TakeTriangles(), weight, options.padding, region);
  if (parts.regions.size() == 1) {
    Partitioner partitioner(options, emit);
    QUARRY_TRY(partitioner.ChainFile(triangles, region, content));
    return std::move(partitioner.tree);
  }
  QUARRY_ASSIGN(RegionFiles files, RegionFiles::Open(parts, options.spill_prefix, triangles.element_bytes(),
                                                     options.memory, 0, {}, {}));
  QUARRY_TRY(files.Add(triangles, 0, triangles.count(), options.padding, [](uint64_t) {}));
  QUARRY_TRY(files.FinishWriting());
  CutOffEmptySpace(files.contents(), region.cell, parts);
  TopSubtree tree{parts.nodes, 0};
  PartitionOptions inner = options;
  for (size_t i = 0; i < parts.regions.size(); ++i) {
    inner.spill_prefix = fmt::format("{}{}-", options.spill_prefix, i);
    QUARRY_ASSIGN(const TopSubtree part,
                  PartitionFile(files.file(i), parts.regions[i], files.contents()[i], inner, emit));
    files.file(i).Remove();
    Graft(part, parts.leaves[i], tree.voxels, tree.nodes);
    tree.voxels += part.voxels;
  }
  return tree;
}

void Graft(const TopSubtree& part, uint32_t at, uint32_t first_voxel, std::vector<KdNode>& nodes) {
  const auto moved = static_cast<uint32_t>(nodes.size()) - 1;  // the subtree's node 1 goes to the end
  const auto place = [&](KdNode node) {
    if (!node.is_leaf()) return KdNode::Inner(node.axis(), node.split(), node.left() + moved);
    return node.count() == 0 ? node : KdNode::Leaf(node.first() + first_voxel, node.count());
  };
  nodes[at] = place(part.nodes[0]);
  for (size_t i = 1; i < part.nodes.size(); ++i) nodes.push_back(place(part.nodes[i]));
}

}  // namespace quarry

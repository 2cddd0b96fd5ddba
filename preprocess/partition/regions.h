#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/base/status.h"
#include "common/kdtree/node.h"
#include "preprocess/partition/sample.h"
#include "preprocess/partition/split.h"
#include "preprocess/spill/spill_files.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// A cell in the upper part of the top-level tree, with as many triangles as are split in memory at once.
struct Region {
  Box cell;
  int depth = 0;      ///< of its node, from the root
  double growth = 1;  ///< of the triangle count by replication, along its path
  double share = 1;   ///< its part of all triangles
};

/// The upper part of the top-level tree. Its leaves are KdNode::Leaf(region, 1), in depth-first order.
struct RegionTree {
  std::vector<KdNode> nodes;
  std::vector<Region> regions;
  std::vector<uint32_t> leaves;  ///< each region's node
};

/// Triangles of a region, estimated. A constant, so that stores do not depend on --memory: large enough that
/// few planes are chosen by sampling, small enough to split in memory.
inline constexpr uint64_t kRegionTriangles = 128 << 10;
/// Triangles that are split in memory; a larger region is cut into regions of its own.
inline constexpr uint64_t kMostInMemory = 256 << 10;
/// Triangles that are routed between two checkpoints.
inline constexpr uint64_t kRoutedPerCheckpoint = 8 << 20;

/// Cuts `whole` into regions of about kRegionTriangles by the planes of a kd-tree over a sample. Each sampled
/// triangle stands for `weight` triangles; with a weight above 1, planes lie at bin borders, since other
/// triangles reach beyond the sampled. Returns one region if no plane splits it usefully or planes would cut
/// too many triangles. Deterministic.
RegionTree ChooseRegions(const std::vector<KdTriangle>& sample, uint64_t weight, float padding,
                         const Region& whole);

/// Cuts off the empty space around regions and groups of regions, which the sample knew only in part.
/// `contents`: bounds of each region's triangles, EmptyBox() for none. `whole`: the root's cell.
void CutOffEmptySpace(const std::vector<Box>& contents, const Box& whole, RegionTree& tree);

/// Files of triangles, one a region: each triangle is routed to the regions that it reaches beyond the
/// padding. All regions fill at once, so every triangle is read and written once, whatever the model's size.
/// Thread safety: none.
class RegionFiles {
 public:
  /// Opens the files PREFIX0, PREFIX1, ... `counts`, `contents`: their state by an earlier run, or empty; the
  /// first `gone` files may be absent. Units: `memory` in bytes, shared by the files' buffers. `tree` must
  /// outlive the object. Errors: cannot be opened; a file has fewer triangles than it had.
  static Result<RegionFiles> Open(const RegionTree& tree, const std::string& prefix, size_t record_bytes,
                                  uint64_t memory, size_t gone, const std::vector<uint64_t>& counts,
                                  const std::vector<Box>& contents);

  /// Routes the records [first, last) of `triangles`, in order, on two threads. `padding`: of their boxes.
  /// `progress` is called now and then with the next record's number. Errors: disk full.
  Status Add(const SpillFile& triangles, uint64_t first, uint64_t last, float padding,
             const std::function<void(uint64_t)>& progress);
  Status FinishWriting() { return files_.FinishWriting(); }
  /// Writes the buffers out: the triangles so far survive the process. Errors: disk full.
  Status WriteOut() { return files_.WriteOut(); }

  SpillFile& file(size_t region) { return files_[region]; }
  const SpillFile& file(size_t region) const { return files_[region]; }
  std::vector<uint64_t> counts() const { return files_.counts(); }
  /// Bounds of the boxes of each region's triangles, clipped to its cell.
  const std::vector<Box>& contents() const { return contents_; }

 private:
  /// Consecutive records, and the regions of each.
  struct Routed {
    std::unique_ptr<std::byte[]> records;
    uint64_t count = 0;
    std::vector<std::pair<uint32_t, uint32_t>> places;  ///< pairs of region and record
    Status status;
  };
  RegionFiles(const RegionTree& tree, SpillFiles files) : tree_(&tree), files_(std::move(files)) {}
  Routed Route(const SpillFile& triangles, uint64_t first, uint64_t count, float padding);
  const RegionTree* tree_;
  SpillFiles files_;
  std::vector<Box> contents_;
};

/// Calls `visit` with each leaf of a tree that a box touches.
template <class Visit>
void ForEachLeaf(const std::vector<KdNode>& nodes, const Box& box, Visit&& visit) {
  uint32_t waiting[kMostLevels + 1];
  int open = 0;
  waiting[open++] = 0;
  while (open > 0) {
    const KdNode node = nodes[waiting[--open]];
    if (node.is_leaf()) {
      visit(node);
      continue;
    }
    if (box.upper[node.axis()] >= node.split()) waiting[open++] = node.left() + 1;
    if (box.lower[node.axis()] <= node.split()) waiting[open++] = node.left();
  }
}

/// The padded box of a triangle's part in a cell, clipped to the cell. `box`: the triangle's padded box.
/// Nothing: the triangle passes beside the cell.
std::optional<Box> PartIn(const TriangleRecord& triangle, const Box& box, const Box& cell, float padding);

/// Calls `visit` with each region that a triangle reaches, and the padded box of its part there.
template <class Visit>
void ForEachRegion(const RegionTree& tree, const TriangleRecord& record, float padding, Visit&& visit) {
  const Box box = record.PaddedBox(padding);
  ForEachLeaf(tree.nodes, box, [&](KdNode leaf) {
    if (leaf.count() == 0) return;
    if (const auto part = PartIn(record, box, tree.regions[leaf.first()].cell, padding))
      visit(leaf.first(), *part);
  });
}

/// Calls `visit`, which returns a Status, with the records [first, last) of a spill file. Errors: a read
/// error; as `visit`'s.
template <class Visit>
Status ForEachRecord(const SpillFile& file, uint64_t first, uint64_t last, Visit&& visit) {
  SpillReader reader(file, first, last);
  TriangleRecord record;
  while (const std::byte* bytes = reader.Next()) {
    CopyRecord(bytes, file.element_bytes(), record);
    QUARRY_TRY(visit(record));
  }
  return reader.status();
}

}  // namespace quarry

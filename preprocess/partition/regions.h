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
#include "preprocess/spill/spill_file.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// A cell of the top-level tree's upper part, with as many triangles as are split in memory at once.
struct Region {
  Box cell;
  int depth = 0;      ///< of its node
  double growth = 1;  ///< of the number of triangles by replication, along its path
  double share = 1;   ///< of all triangles, those in it
};

/// The upper part of the top-level tree. Its leaves are KdNode::Leaf(region, 1), in depth-first order.
struct RegionTree {
  std::vector<KdNode> nodes;
  std::vector<Region> regions;
  std::vector<uint32_t> leaves;  ///< the node of each region
};

/// Triangles of a region, by estimate. Constants, so that stores do not depend on the memory at hand.
inline constexpr uint64_t kRegionTriangles = 128 << 10;
/// Triangles that are split in memory: beyond it a region has regions of its own.
inline constexpr uint64_t kMostInMemory = 256 << 10;
/// Triangles handed out between two notes of how far that is.
inline constexpr uint64_t kRoutedPerCheckpoint = 8 << 20;

/// Cuts `whole` into regions of about kRegionTriangles, by the planes that a kd-tree over a sample of its
/// triangles would have, each standing for `weight` of them; if that is more than 1, at borders of bins,
/// since the others reach beyond those of the sample. One region, when no plane parts
/// it usefully, or planes would cut too many.
RegionTree ChooseRegions(const std::vector<KdTriangle>& sample, uint64_t weight, float padding,
                         const Region& whole);

/// Cuts off the empty space around regions, and groups of them, whose triangles lie in `contents` (EmptyBox()
/// where there are none): the sample knew of some of it at most. `whole` is the root's cell.
void CutOffEmptySpace(const std::vector<Box>& contents, const Box& whole, RegionTree& tree);

/// Triangles handed out to the regions that they reach, but for the padding, on disk: all regions at once, so
/// that every triangle is read and written once whatever the size of the model. Not thread-safe.
class RegionFiles {
 public:
  /// Files PREFIX0, PREFIX1 and so on. `counts` and `contents`: what an earlier run had in them, or empty;
  /// the first `gone` need not be there any more. Their buffers share `memory` bytes. `tree` must outlive the
  /// object.
  static Result<RegionFiles> Open(const RegionTree& tree, const std::string& prefix, size_t record_bytes,
                                  uint64_t memory, size_t gone, const std::vector<uint64_t>& counts,
                                  const std::vector<Box>& contents);

  /// Adds the records [first, last) of `triangles`, in their order, on two threads; `padding`: of their
  /// boxes. `progress` is called with the number of the next record now and then. Errors: disk full.
  Status Add(const SpillFile& triangles, uint64_t first, uint64_t last, float padding,
             const std::function<void(uint64_t)>& progress);
  Status FinishWriting();
  /// What was added outlasts a loss of power.
  Status Sync();

  SpillFile& file(size_t region) { return files_[region]; }
  std::vector<uint64_t> counts() const;
  /// Bounds of the boxes of each region's triangles, clipped to its cell.
  const std::vector<Box>& contents() const { return contents_; }

 private:
  /// Records in a row, and which goes to which regions.
  struct Routed {
    std::vector<std::byte> records;
    std::vector<std::pair<uint32_t, uint32_t>> places;  ///< region, record
    Status status;
  };
  explicit RegionFiles(const RegionTree& tree) : tree_(&tree) {}
  Routed Route(const SpillFile& triangles, uint64_t first, uint64_t count, float padding);
  const RegionTree* tree_;
  std::string prefix_;
  std::vector<SpillFile> files_;
  std::unique_ptr<SpillWriter> writer_ = std::make_unique<SpillWriter>();  ///< of files_: ends before them
  std::vector<Box> contents_;
};

/// The padded box of what of a triangle is in a cell, cut off at the cell; nothing if it passes beside.
std::optional<Box> PartIn(const TriangleRecord& triangle, const Box& cell, float padding);

/// Calls `visit` with the records [first, last) of a spill file.
Status ForEachRecord(const SpillFile& file, uint64_t first, uint64_t last,
                     const std::function<Status(const TriangleRecord&)>& visit);

}  // namespace quarry

#pragma once

#include <functional>
#include <vector>

#include "common/base/status.h"
#include "preprocess/partition/partition.h"
#include "preprocess/spill/spill_file.h"

namespace quarry {

/// Gives smooth normals to a region's triangles in memory; see PartitionSmoothed().
Status SmoothRecords(std::vector<TriangleRecord>& records, const Box& cell, const SpillFile* border,
                     double crease);

/// Partitions a region as PartitionFile() does, after its triangles got smooth normals; with a crease of 0
/// they get none. `border`: the normals of corners outside the region's cell, in any order; null: there are
/// no other regions. `drop`, if it is not empty, is called once for each triangle; a triangle for which it
/// returns true takes part in smoothing and is then left out. Units: crease in degrees. Errors: as
/// PartitionFile()'s.
Result<TopSubtree> PartitionSmoothed(const SpillFile& triangles, const Region& region, const Box& content,
                                     const PartitionOptions& options, const SpillFile* border, double crease,
                                     const std::function<Status(VoxelTask)>& emit,
                                     const std::function<bool(const TriangleRecord&)>& drop = {});

}  // namespace quarry

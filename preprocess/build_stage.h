#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "common/base/progress.h"
#include "common/base/status.h"
#include "common/voxel/store_writer.h"
#include "preprocess/ingest/imported_scene.h"
#include "preprocess/partition/partition.h"
#include "preprocess/partition/regions.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/preprocess_statistics.h"
#include "preprocess/smooth/border_normals.h"
#include "preprocess/texture/cut_outs.h"
#include "preprocess/texture/texture_stage.h"
#include "preprocess/work_folder.h"

namespace quarry {

/// The second stage of a run: from triangles to a store. A scene that memory holds is partitioned at once; a
/// larger one is routed to the files of regions, which are then partitioned one after the other. Voxels, then
/// textures, go to the store as they are made, and checkpoints to the work folder's journal.
/// The arguments must outlive the stage. Thread safety: none; voxels are built by options.threads threads.
class BuildStage {
 public:
  BuildStage(const PreprocessOptions& options, WorkFolder& work, Progress& progress, ImportedScene& scene);

  /// Writes voxels and texture pages, continuing from the journal. Errors: disk full; the journal cannot be
  /// read; an image's decoder needs more memory than it may have.
  Status Run();
  /// Writes the directory and gives the store its name. Requires: Run() has succeeded.
  Status Finish(PreprocessStatistics& statistics);

 private:
  using Clock = std::chrono::steady_clock;
  Status Restore();
  Status RestoreRecord(const SavedCheckpoint& checkpoint);
  Status ChooseTree();
  Status Route();
  Status SmoothBorders();
  Status ReadCutOuts();
  Result<TopSubtree> PartitionRegion(size_t region, const PartitionOptions& options,
                                     const std::function<Status(VoxelTask)>& emit, uint64_t& dropped) const;
  Status BuildVoxels();
  Status SaveBuilt(bool now = false);

  const PreprocessOptions& options_;
  WorkFolder& work_;
  Progress& progress_;
  ImportedScene& scene_;
  const SceneMeta meta_;
  Region whole_;
  PartitionOptions partition_;

  RegionTree tree_;
  std::optional<RegionFiles> files_;      ///< absent if there is only one region
  uint64_t routed_ = 0;                   ///< triangles in their regions' files
  std::vector<uint64_t> counts_;          ///< triangles of each region's file, by an earlier run
  std::vector<Box> contents_;             ///< bounds of each region's triangles, by an earlier run
  std::optional<BorderNormals> borders_;  ///< absent if nothing is smoothed, or there is only one region
  uint32_t smoothed_ = 0;                 ///< regions whose borders are done
  std::vector<uint64_t> border_counts_;   ///< normals in each region's file, by an earlier run

  CutOuts cut_outs_;
  TextureStage textures_;
  std::optional<StoreWriter> writer_;
  StoreProgress stored_;              ///< the part of the store that an earlier run has written
  std::vector<TopSubtree> subtrees_;  ///< of the regions partitioned so far
  std::vector<uint64_t> dropped_;     ///< transparent triangles of each, counted once a scene
  uint64_t emitted_ = 0;              ///< triangles in voxels, copies counted
  size_t saved_regions_ = 0;          ///< regions whose voxels the journal has
  uint32_t saved_voxels_ = 0;
  uint64_t saved_part_bytes_ = 0;  ///< of VoxelPartLists
  Clock::time_point saved_at_;
};

}  // namespace quarry

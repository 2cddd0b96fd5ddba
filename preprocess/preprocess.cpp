#include "preprocess/preprocess.h"

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <filesystem>

#include "common/base/file_lock.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/kdtree/triangle_test.h"
#include "preprocess/import/importer.h"
#include "preprocess/partition.h"
#include "preprocess/spill_sink.h"
#include "preprocess/voxel_builder.h"
#include "preprocess/voxel_pipeline.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

Result<ImportedScene> ImportAll(const PreprocessOptions& options, const std::string& tmp,
                                Progress& progress) {
  SpillSink sink(tmp, options.memory, options.scale,
                 [&](const std::string& text) { progress.Say("warning: " + text); });
  for (const std::string& model : options.models) {
    progress.Say(fmt::format("reading {}", model));
    QUARRY_TRY(ImportModel(model, sink));
  }
  return sink.Finish();
}

SceneMeta MakeMeta(const ImportedScene& scene, const PreprocessOptions& options) {
  SceneMeta meta;
  meta.offset = scene.offset;
  meta.bounds_lower = scene.bounds.lower;
  meta.bounds_upper = scene.bounds.upper;
  float largest = 0;
  for (int a = 0; a < 3; ++a)
    largest = std::max({largest, std::fabs(scene.bounds.lower[a]), std::fabs(scene.bounds.upper[a])});
  meta.padding = ReferencePadding(largest);
  meta.root_lower = scene.bounds.lower - glm::vec3(2 * meta.padding);
  meta.root_upper = scene.bounds.upper + glm::vec3(2 * meta.padding);
  meta.up_axis = options.up_axis;
  meta.input_triangles = scene.input_triangles;
  meta.dropped_degenerate = scene.dropped_degenerate;
  meta.dropped_not_finite = scene.dropped_not_finite;
  meta.voxel_size = options.voxel_size;
  return meta;
}

/// Steps from the root to the deepest leaf. Children lie beyond their parents.
uint32_t DepthOf(const std::vector<KdNode>& nodes) {
  std::vector<uint32_t> depth(nodes.size());
  uint32_t deepest = 0;
  for (size_t i = 0; i < nodes.size(); ++i) {
    deepest = std::max(deepest, depth[i]);
    if (!nodes[i].is_leaf()) depth[nodes[i].left()] = depth[nodes[i].left() + 1] = depth[i] + 1;
  }
  return deepest;
}

}  // namespace

std::string SpillFolder(const PreprocessOptions& options) {
  if (!options.tmp_folder.empty()) return options.tmp_folder;
  const auto parent = std::filesystem::path(options.output).parent_path();
  return parent.empty() ? "." : parent.string();
}

Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options) {
  const auto start = Clock::now();
  Progress progress(options.quiet);
  const std::string tmp = SpillFolder(options);
  // The output first: an unwritable place should not cost an import.
  QUARRY_ASSIGN(const FileLock lock, FileLock::Take(options.output, "another quarry-preprocess"));
  QUARRY_ASSIGN(StoreWriter writer, StoreWriter::Create(options.output));
  QUARRY_ASSIGN(ImportedScene scene, ImportAll(options, tmp, progress));
  PreprocessStatistics statistics;
  statistics.import_wall_s = SecondsSince(start);
  statistics.warnings = scene.warnings.size();

  const SceneMeta meta = MakeMeta(scene, options);
  const uint64_t triangles = scene.triangles->count();
  const auto build_start = Clock::now();
  progress.Begin(fmt::format("building voxels of {} triangles", triangles), "triangles");
  const Box root{meta.root_lower, meta.root_upper};
  VoxelPipeline pipeline(
      options.threads,
      [&](const VoxelTask& task) {
        EncodedVoxel voxel =
            BuildVoxel(task.triangles, task.cell, meta.padding, scene.has_shading, options.voxel_size);
        voxel.chained = task.chained;
        return voxel;
      },
      [&](const EncodedVoxel& voxel) { return writer.AddVoxel(voxel); });
  uint64_t emitted = 0;
  QUARRY_ASSIGN(const std::vector<KdNode> top,
                Partition(std::move(*scene.triangles), scene.has_shading, root, root, meta.padding,
                          {tmp, options.memory, options.voxel_size}, [&](VoxelTask task) {
                            emitted += task.triangles.size();
                            progress.Update(std::min(emitted, triangles), triangles);
                            return pipeline.Add(std::move(task));
                          }));
  QUARRY_TRY(pipeline.Finish());
  progress.End();
  statistics.voxels = writer.voxel_count();
  statistics.stored_references = emitted;
  statistics.top_tree_nodes = static_cast<uint32_t>(top.size());
  statistics.top_tree_depth = DepthOf(top);
  statistics.meta = meta;
  QUARRY_ASSIGN(statistics.scene_id, writer.Finish(statistics.meta, top, scene.materials, scene.parts));
  statistics.store_bytes = writer.bytes_written();
  statistics.build_wall_s = SecondsSince(build_start);
  statistics.preprocess_wall_s = SecondsSince(start);
  statistics.peak_rss_bytes = PeakResidentBytes();
  return statistics;
}

}  // namespace quarry

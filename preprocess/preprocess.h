#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "common/voxel/catalog.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/texture/texture_stage.h"

namespace quarry {

/// What a run did; written as JSON by --stats, each name with its unit.
struct PreprocessStatistics {
  SceneId scene_id{};
  SceneMeta meta;
  uint64_t voxels = 0, warnings = 0;
  uint64_t store_bytes = 0;
  double import_wall_s = 0, build_wall_s = 0, preprocess_wall_s = 0;
  uint64_t peak_rss_bytes = 0;
  uint64_t stored_references = 0;  ///< triangles over all voxels, with replication
  uint32_t top_tree_nodes = 0, top_tree_depth = 0;
  TextureStatistics textures;
};

/// Makes a scene store of one or several models. Nothing is at `output` unless it succeeds; what is on the
/// way is in "OUTPUT.work", and in a folder of that name in tmp_folder. Memory: at most options.memory plus
/// the fixed overhead stated in the README.
Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options);

}  // namespace quarry

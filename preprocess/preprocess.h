#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/voxel/catalog.h"
#include "preprocess/preprocess_options.h"
#include "preprocess/texture/texture_stage.h"

namespace quarry {

/// Statistics of a run; --stats writes them as JSON, each name with its unit.
struct PreprocessStatistics {
  SceneId scene_id{};
  SceneMeta meta;
  uint64_t voxels = 0, warnings = 0;
  std::vector<std::string> notes;  ///< how models were read, a sentence each
  uint64_t store_bytes = 0;
  double up_evidence = 0;  ///< of the triangles, see UpEvidence()
  double import_wall_s = 0, build_wall_s = 0, preprocess_wall_s = 0;
  uint64_t peak_rss_bytes = 0;
  uint64_t stored_references = 0;  ///< triangles over all voxels, copies counted
  uint32_t top_tree_nodes = 0, top_tree_depth = 0;
  TextureStatistics textures;
};

/// Makes a scene store of one or several models. Nothing is at `output` unless it succeeds; meanwhile files
/// lie in "OUTPUT.work" and in a folder of that name in tmp_folder. Continues an earlier run if
/// options.resume says so; killed, it leaves these folders for the next run.
/// Memory: at most options.memory and the overhead in README.md, "Limits". Thread safety: one run a process.
/// Errors: a sentence with the file and what to do.
Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options);

}  // namespace quarry

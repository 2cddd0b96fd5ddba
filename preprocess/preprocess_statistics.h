#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/voxel/catalog.h"
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

}  // namespace quarry

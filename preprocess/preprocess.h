#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/voxel/catalog.h"
#include "preprocess/import/foreign.h"
#include "preprocess/spill_sink.h"
#include "preprocess/texture/texture_stage.h"

namespace quarry {

struct PreprocessOptions {
  std::vector<std::string> models;
  std::string output;
  std::string tmp_folder;        ///< empty: the output's folder
  uint64_t memory = 1ull << 30;  ///< bytes
  unsigned threads = 1;
  uint32_t voxel_size = 256u << 10;  ///< bytes of a decoded hot block, at most
  uint32_t up_axis = 2;
  double scale = 1;
  std::map<std::string, Placement> placements;  ///< of some models, by the path given
  bool textures = true;                         ///< carry the images that materials name
  bool resume = false;  ///< go on with what an earlier run of the same options has left
  bool quiet = false;
};

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

/// How a run reads formats that Quarry has no reader for: by the program beside its own, if that is there.
ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix);
/// And images.
ImageDecoding ImageDecodingOf(const PreprocessOptions& options);

/// Where a run puts its temporary files.
std::string SpillFolder(const PreprocessOptions& options);

/// Makes a scene store of one or several models. Nothing is at `output` unless it succeeds; what is on the
/// way is in "OUTPUT.work", and in a folder of that name in tmp_folder. Memory: at most options.memory plus
/// the fixed overhead stated in the README.
Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options);

}  // namespace quarry

#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "preprocess/import/foreign/foreign.h"
#include "preprocess/ingest/scene_coordinates.h"
#include "preprocess/texture/image_decoder.h"

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
  double checkpoint_seconds = 5;                ///< of work that is done again after a kill, or one unit
  /// Whether to go on with what an earlier run of the same options has left: with kIfFit a run that cannot
  /// go on (another version, changed models) begins anew.
  enum class Resume { kNo, kYes, kIfFit };
  Resume resume = Resume::kNo;
  /// How a person goes on with what is kept.
  std::string goes_on = "the same command with --resume goes on";
  uint64_t unpack_limit = 0;  ///< bytes that a packed model may unpack to; 0: by its own (model_reader.h)
  bool quiet = false;
};

/// The placement given for a model; the default if there is none.
Placement PlacementOf(const PreprocessOptions& options, const std::string& model);

/// How a run reads formats that Quarry has no reader for: by the program beside its own, if that is there.
ForeignFormats ForeignFormatsOf(const PreprocessOptions& options, const std::string& prefix);
/// And images.
ImageDecoding ImageDecodingOf(const PreprocessOptions& options);

/// Where a run puts its temporary files.
std::string SpillFolder(const PreprocessOptions& options);

}  // namespace quarry

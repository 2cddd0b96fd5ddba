#pragma once

#include <cstdint>
#include <string>

#include "common/base/status.h"
#include "preprocess/preprocess_options.h"

namespace quarry {

/// A number of bytes that is known only roughly: of usual models, and its bounds.
struct ByteEstimate {
  uint64_t least = 0, usual = 0, most = 0;
};

/// An estimate of a run's needs, made before it.
struct PreprocessPlan {
  uint64_t triangles = 0, vertices = 0;  ///< as counted in the models; exact
  bool has_shading = false;              ///< normals, texture coordinates or colours
  ByteEstimate spill;                    ///< peak, in the folder for spill
  ByteEstimate store;                    ///< textures included
  uint64_t texture_bytes = 0;            ///< of decoded textures; a store never has more
  uint64_t memory_bytes = 0;             ///< an upper bound
  double seconds = 0;                    ///< roughly: wall time on this machine when it is otherwise idle
};

/// Estimates a run. Reads the models once, to count their elements, and the headers of their images. Bytes
/// are counts times the bytes a triangle of measured scenes: the least, the mean of usual ones, and the most
/// (tests/bench/history/preprocess.md).
/// Errors: as Preprocess() for models that cannot be read.
Result<PreprocessPlan> MakePlan(const PreprocessOptions& options);

/// Whether free space is so small, compared to the models' size, that an estimate is worth its time.
bool RoomIsTight(const PreprocessOptions& options);

/// Compares a plan with the room in the folders for the store and for spill. Returns a warning if a folder
/// has room for the least that the plan names but not for the most; else an empty text.
/// Errors: a folder lacks room for the least; the sentence names the folder.
Result<std::string> CheckRoom(const PreprocessOptions& options, const PreprocessPlan& plan);

}  // namespace quarry

#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "preprocess/preprocess_options.h"

namespace quarry {

/// An estimate of a run's needs, made before it.
struct PreprocessPlan {
  uint64_t triangles = 0, vertices = 0;  ///< as counted in the models; exact
  bool has_shading = false;              ///< normals, texture coordinates or colours
  uint64_t spill_bytes = 0;              ///< peak, in the folder for spill
  uint64_t store_bytes = 0;              ///< of the store, textures included
  uint64_t texture_bytes = 0;            ///< of textures, by the sizes in the images' headers
  uint64_t memory_bytes = 0;             ///< an upper bound
  double seconds = 0;                    ///< wall time on this machine when it is otherwise idle
};

/// Estimates a run. Reads the models two or three times: to count and to choose regions as a run does, then
/// for the triangles of some regions (plan_regions.h), which lie in the spill folder meanwhile. Where
/// --memory does not hold the vertices, cubes take the regions' place (plan_sample.h). Times and sizes follow
/// from building those triangles.
/// Errors: as Preprocess() for models that cannot be read; a model from standard input.
Result<PreprocessPlan> MakePlan(const PreprocessOptions& options);

/// Whether free space is so small, compared to the models' size, that an estimate is worth its time.
bool RoomIsTight(const PreprocessOptions& options);

/// Errors: the folders for the store and for spill lack the room that `plan` needs; the sentence names both.
Status CheckRoom(const PreprocessOptions& options, const PreprocessPlan& plan);

}  // namespace quarry

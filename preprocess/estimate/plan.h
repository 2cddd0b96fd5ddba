#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "preprocess/preprocess.h"

namespace quarry {

/// What a run will take, told beforehand.
struct PreprocessPlan {
  uint64_t triangles = 0, vertices = 0;  ///< as counted in the models; exact
  bool has_shading = false;              ///< normals, texture coordinates or colours
  uint64_t spill_bytes = 0;              ///< most at any time, in the folder for spill
  uint64_t store_bytes = 0;              ///< of the store, textures among them
  uint64_t texture_bytes = 0;            ///< of textures, by the sizes that images say they have
  uint64_t memory_bytes = 0;             ///< a bound
  double seconds = 0;                    ///< on this machine, with nothing else to do
};

/// Reads the models two or three times: to count and to choose regions as a run does, and for the triangles
/// of some regions (plan_regions.h), which lie in the spill folder meanwhile; where --memory does not hold
/// the vertices, for the triangles in several cubes (plan_sample.h) instead. What is there is built; times
/// and sizes follow from that. Errors: as Preprocess for models that cannot be read; a model from standard
/// input.
Result<PreprocessPlan> MakePlan(const PreprocessOptions& options);

/// Whether the folders have so little room, beside the models' size, that a plan is worth its time.
bool RoomIsTight(const PreprocessOptions& options);

/// An error that names both, when the folders for the store and for spill have not the room that `plan`
/// wants.
Status CheckRoom(const PreprocessOptions& options, const PreprocessPlan& plan);

}  // namespace quarry

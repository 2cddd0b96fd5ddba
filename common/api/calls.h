#pragma once

#include "common/api/quarry.h"

// The calls of quarry.h behind the check of the processor. Thread-safe. None throws.
namespace quarry::api {

/// Of this library, for quarry_version().
extern const char* const kRelease;
/// The sentence of quarry_error() on this thread. KeepSentence() replaces it; a text is cut to 1,023 bytes.
const char* Sentence();
void KeepSentence(const char* text);

quarry_status Open(const char* place, const quarry_options* options, quarry_scene** scene);
quarry_status Close(quarry_scene* scene);
quarry_status Describe(quarry_scene* scene, quarry_description* description);
quarry_status PartName(quarry_scene* scene, uint32_t part, char* name, size_t capacity, size_t* length);
quarry_status MaterialName(quarry_scene* scene, uint32_t material, char* name, size_t capacity,
                           size_t* length);
quarry_status Nearest(quarry_scene* scene, const quarry_rays* rays, const quarry_hits* hits);
quarry_status Any(quarry_scene* scene, const quarry_rays* rays, uint8_t* hit);
quarry_status Count(quarry_scene* scene, const quarry_rays* rays, uint32_t* counts);
quarry_status All(quarry_scene* scene, const quarry_rays* rays, const uint64_t* splits,
                  const quarry_hits* hits);
quarry_status Pinhole(const double* eye, const double* at, const double* up, double fov_degrees,
                      int which_fov, uint32_t width, uint32_t height, double* rays);
quarry_status Cancel(quarry_scene* scene, uint64_t tag);
quarry_status Measure(quarry_scene* scene, quarry_statistics* statistics);

}  // namespace quarry::api

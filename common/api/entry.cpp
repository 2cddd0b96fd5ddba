// The exported calls, compiled for plain x86-64 (see CMakeLists.txt): each asks the processor before it
// enters code that needs AVX2. No template or inline function of another header may be used here: the linker
// keeps one copy of each, which may be one for AVX2.
#include "common/api/calls.h"
#include "common/api/quarry.h"

using namespace quarry;

namespace {

bool HasAvx2() {
  __builtin_cpu_init();
  return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
}

template <class... Parameters, class... Arguments>
quarry_status Call(quarry_status (*call)(Parameters...), Arguments... arguments) {
  if (!HasAvx2()) {
    api::KeepSentence("this processor lacks AVX2, FMA and BMI2 (x86-64-v3), which Quarry needs");
    return QUARRY_PROCESSOR;
  }
  return call(arguments...);
}

}  // namespace

const char* quarry_error(void) { return api::Sentence(); }
const char* quarry_version(void) { return api::kRelease; }

quarry_status quarry_open(const char* place, const quarry_options* options, quarry_scene** scene) {
  if (scene) *scene = nullptr;
  return Call(api::Open, place, options, scene);
}
quarry_status quarry_close(quarry_scene* scene) { return Call(api::Close, scene); }
quarry_status quarry_describe(quarry_scene* scene, quarry_description* description) {
  return Call(api::Describe, scene, description);
}
quarry_status quarry_part_name(quarry_scene* scene, uint32_t part, char* name, size_t capacity,
                               size_t* length) {
  return Call(api::PartName, scene, part, name, capacity, length);
}
quarry_status quarry_material_name(quarry_scene* scene, uint32_t material, char* name, size_t capacity,
                                   size_t* length) {
  return Call(api::MaterialName, scene, material, name, capacity, length);
}
quarry_status quarry_nearest(quarry_scene* scene, const quarry_rays* rays, const quarry_hits* hits) {
  return Call(api::Nearest, scene, rays, hits);
}
quarry_status quarry_any(quarry_scene* scene, const quarry_rays* rays, uint8_t* hit) {
  return Call(api::Any, scene, rays, hit);
}
quarry_status quarry_count(quarry_scene* scene, const quarry_rays* rays, uint32_t* counts) {
  return Call(api::Count, scene, rays, counts);
}
quarry_status quarry_all(quarry_scene* scene, const quarry_rays* rays, const uint64_t* splits,
                         const quarry_hits* hits) {
  return Call(api::All, scene, rays, splits, hits);
}
quarry_status quarry_pinhole(const double* eye, const double* at, const double* up, double fov_degrees,
                             int which_fov, uint32_t width, uint32_t height, double* rays) {
  return Call(api::Pinhole, eye, at, up, fov_degrees, which_fov, width, height, rays);
}
quarry_status quarry_cancel(quarry_scene* scene, uint64_t tag) { return Call(api::Cancel, scene, tag); }
quarry_status quarry_measure(quarry_scene* scene, quarry_statistics* statistics) {
  return Call(api::Measure, scene, statistics);
}

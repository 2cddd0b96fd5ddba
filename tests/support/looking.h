#pragma once

#include <catch2/catch.hpp>

#include "common/scene/render_job.h"

namespace quarry::test {

/// A normalized job with a frame that looks from `eye` to `at`, z up.
inline RenderJob Looking(glm::dvec3 eye, glm::dvec3 at, uint32_t width = 320, uint32_t height = 256) {
  RenderJob job;
  job.width = width;
  job.height = height;
  CameraSpec camera;
  camera.eye = eye;
  camera.at = at;
  camera.up = {0, 0, 1};
  job.cameras = {camera};
  REQUIRE(NormalizeJob(job).has_value());
  return job;
}

}  // namespace quarry::test

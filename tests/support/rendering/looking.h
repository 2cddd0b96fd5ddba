#pragma once

#include <catch2/catch.hpp>

#include "common/scene/render_job.h"

namespace quarry::test {

/// A view from `eye` towards `at`, z up.
inline View Looking(glm::dvec3 eye, glm::dvec3 at, uint32_t width = 320, uint32_t height = 256) {
  View view;
  view.width = width;
  view.height = height;
  view.camera.eye = eye;
  view.camera.at = at;
  view.camera.up = {0, 0, 1};
  REQUIRE(NormalizeView(view).has_value());
  return view;
}

/// A job of so many frames, all of this view.
inline RenderJob JobOf(const View& view, size_t frames = 1) {
  RenderJob job;
  job.view = view;
  job.cameras.assign(frames, view.camera);
  REQUIRE(NormalizeJob(job).has_value());
  return job;
}

}  // namespace quarry::test

#pragma once

#include <atomic>
#include <cstdint>
#include <utility>

#include "common/scene/camera.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A view of a scene, prepared once for all of its tiles. Immutable except `abandoned`.
/// Requires: the view is normalized.
struct ViewContext {
  ViewContext(View a_view, const Catalog& scene)
      : view(std::move(a_view)),
        catalog(scene),
        top(scene.top_tree()),
        camera(view.camera, view.width, view.height, scene.meta.root_lower, scene.meta.root_upper),
        words(WordsPerPixel(view.aov_mask)) {}
  const View view;
  const Catalog& catalog;
  const TopTree top;
  const Camera camera;
  const uint32_t words;                ///< 32-bit words per pixel
  std::atomic<bool> abandoned{false};  ///< its tiles are wanted no more
};

}  // namespace quarry

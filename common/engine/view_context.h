#pragma once

#include <atomic>
#include <cstdint>
#include <utility>

#include "common/scene/camera.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// A view of a scene, prepared once for all of its tiles. Immutable but for `abandoned`.
/// Requires: a normalized view.
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
  const uint32_t words;                ///< 32-bit words a pixel
  std::atomic<bool> abandoned{false};  ///< nobody waits for its tiles any more
};

}  // namespace quarry

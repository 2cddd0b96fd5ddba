#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <utility>

#include "common/scene/camera.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Length of occlusion rays in kAo: a share of the scene's diagonal, so that a room's corners and the gaps
/// between a machine's parts darken, and a room as a whole does not. Units: scene units.
inline float DefaultAoDistance(const SceneMeta& scene) {
  constexpr float kShare = 0.05f;
  const glm::vec3 size = scene.bounds_upper - scene.bounds_lower;
  return kShare * std::sqrt(glm::dot(size, size));
}

/// A view of a scene, prepared once for all of its tiles. Immutable except `abandoned`.
/// Requires: the view is normalized.
struct ViewContext {
  ViewContext(View a_view, const Catalog& scene)
      : view(std::move(a_view)),
        catalog(scene),
        top(scene.top_tree()),
        camera(view.camera, view.width, view.height, scene.meta.root_lower, scene.meta.root_upper),
        words(WordsPerPixel(view.aov_mask)),
        ao_distance(view.ao_distance > 0 ? view.ao_distance : DefaultAoDistance(scene.meta)),
        up((view.up_axis != 0 ? view.up_axis : scene.meta.up_axis) == 1 ? glm::vec3(0, 1, 0)
                                                                        : glm::vec3(0, 0, 1)) {}
  const View view;
  const Catalog& catalog;
  const TopTree top;
  const Camera camera;
  const uint32_t words;                ///< 32-bit words per pixel
  const float ao_distance;             ///< scene units
  const glm::vec3 up;                  ///< the dome's zenith in kAo; a unit vector
  std::atomic<bool> abandoned{false};  ///< its tiles are wanted no more
};

}  // namespace quarry

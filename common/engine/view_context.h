#pragma once

#include <atomic>
#include <cmath>
#include <cstdint>
#include <glm/geometric.hpp>
#include <memory>
#include <utility>

#include "common/engine/texture/scene_surfaces.h"
#include "common/scene/camera.h"
#include "common/scene/view.h"
#include "common/scene/view_basis.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Length of occlusion rays in kAo: a share of the scene's diagonal, so that a room's corners and the gaps
/// between a machine's parts darken, and a room as a whole does not. Units: scene units.
inline float DefaultAoDistance(const SceneMeta& scene) {
  constexpr float kShare = 0.05f;
  const glm::vec3 size = scene.bounds_upper - scene.bounds_lower;
  return kShare * std::sqrt(glm::dot(size, size));
}

/// The cone of a pixel's primary rays: its width at the eye, and the growth of the width with the distance.
/// Units: scene units.
struct PixelCone {
  float width, spread;
};

inline PixelCone PixelConeOf(const View& view) {
  const ViewBasis basis = MakeViewBasis(view.camera, view.height);
  const auto side = static_cast<float>(std::sqrt(glm::dot(basis.right, basis.right)));
  return basis.orthographic ? PixelCone{side, 0} : PixelCone{0, side};
}

/// A view of a scene, prepared once for all of its tiles. Immutable except `abandoned`.
/// Requires: the view is normalized.
struct ViewContext {
  /// `a_surfaces`: of the scene, shared by its views; made here if null.
  ViewContext(View a_view, const Catalog& scene, std::shared_ptr<const SceneSurfaces> a_surfaces = {})
      : view(std::move(a_view)),
        catalog(scene),
        surfaces(a_surfaces ? std::move(a_surfaces) : std::make_shared<const SceneSurfaces>(scene)),
        texture_uses(surfaces->textured() ? UsesFor(view) : 0),
        cone(PixelConeOf(view)),
        cut_outs(scene.meta.masks),
        top(scene.top_tree()),
        camera(view.camera, view.width, view.height, scene.meta.root_lower, scene.meta.root_upper),
        words(WordsPerPixel(view.aov_mask)),
        ao_distance(view.ao_distance > 0 ? view.ao_distance : DefaultAoDistance(scene.meta)),
        up((view.up_axis != 0 ? view.up_axis : scene.meta.up_axis) == 1 ? glm::vec3(0, 1, 0)
                                                                        : glm::vec3(0, 0, 1)) {}
  const View view;
  const Catalog& catalog;
  const std::shared_ptr<const SceneSurfaces> surfaces;
  const TextureUses texture_uses;  ///< of textures that the picture needs; 0: of none
  const PixelCone cone;
  const bool cut_outs;  ///< whether hits may lie in holes of triangles
  const TopTree top;
  const Camera camera;
  const uint32_t words;                ///< 32-bit words per pixel
  const float ao_distance;             ///< scene units
  const glm::vec3 up;                  ///< the dome's zenith in kAo; a unit vector
  std::atomic<bool> abandoned{false};  ///< its tiles are wanted no more
};

}  // namespace quarry

#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "common/engine/blocks/environment_pages.h"
#include "common/engine/surfaces/scene_surfaces.h"
#include "common/scene/camera.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

class HitFilter;
class Integrator;
class SectionClip;
class ShownParts;

/// The cone of a pixel's primary rays: its width at the eye, and the growth of the width with the distance.
/// Units: scene units.
struct PixelCone {
  float width, spread;
};

/// A view of a scene, prepared once for all of its tiles. Immutable except `abandoned`.
/// Requires: the view is normalized.
struct ViewContext {
  /// `a_surfaces`: of the scene, shared by its views; made here if null. `an_integrator`: null for the one of
  /// the view's mode.
  /// `parts`: the view's selection, made ready; made here if null. `environment`: the view's.
  ViewContext(View a_view, const Catalog& scene, std::shared_ptr<const SceneSurfaces> a_surfaces = {},
              std::shared_ptr<const Integrator> an_integrator = {},
              std::shared_ptr<const ShownParts> parts = {}, const EnvironmentPages& environment = {});

  const View view;
  const Catalog& catalog;
  const std::shared_ptr<const SceneSurfaces> surfaces;
  const std::shared_ptr<const Integrator> integrator;
  const std::shared_ptr<const HitFilter> filter;     ///< null: all hits count
  const std::shared_ptr<const SectionClip> section;  ///< null: nothing is cut off
  const std::shared_ptr<const ShownParts> shown;     ///< null: all parts as they are
  const bool makes_caps, colors_parts;
  const bool has_attributes;       ///< whether surfaces have the normals, uv and colours of their vertices
  const TextureUses texture_uses;  ///< of textures that the picture needs; 0: of none
  const bool tints_light;          ///< whether some of these tint light on its way through panes
  const PixelCone cone;
  const TopTree top;
  const Camera camera;
  const uint32_t words;                ///< 32-bit words per pixel
  const float offset;                  ///< from a surface to the origin of a ray that leaves it
  std::atomic<bool> abandoned{false};  ///< its tiles are wanted no more
};

}  // namespace quarry

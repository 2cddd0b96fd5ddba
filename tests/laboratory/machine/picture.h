#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/engine/view_context.h"
#include "common/math/sampling.h"
#include "tests/laboratory/machine/ray_state.h"
#include "tests/laboratory/scene.h"

namespace quarry::laboratory {

/// The renderers of Purcell et al. 2002, section 3.1.4.
enum class Renderer {
  kRaycast,  ///< the nearest surface; `quarry render --mode raycast`
  kShadow,   ///< a depth image by rasterising, then shadow rays; `--mode shadow`
  kWhitted,  ///< shadow, reflected and refracted rays; `--mode whitted`
  kPath,     ///< one path a sample with two diffuse bounces; Quarry has no such mode
};
inline constexpr uint32_t kRenderers = 4;
inline constexpr const char* kRendererNames[kRenderers] = {"raycast", "shadow", "whitted", "path"};
inline constexpr uint32_t kPathBounces = 2;

/// A picture to render. Immutable. Thread-safe.
struct Picture {
  Picture(const LaboratoryScene& a_scene, Renderer a_renderer, View view);

  const LaboratoryScene& scene;
  const Renderer renderer;
  const ViewContext context;
  const float offset;                       ///< of rays from the surfaces that they leave, scene units
  std::vector<uint8_t> lets_light_through;  ///< by material
  bool has_see_through = false;             ///< whether a material is see-through

  RayParts parts() const {
    const bool paths = renderer != Renderer::kRaycast;
    return {paths, paths && has_see_through, renderer == Renderer::kWhitted};
  }
  uint32_t pixels() const { return context.view.width * context.view.height; }
};

/// The eye ray of a sample, as workers generate it.
inline PrimaryRay EyeRayOf(const Picture& picture, uint32_t pixel, uint32_t sample) {
  const View& view = picture.context.view;
  const glm::vec2 at = PixelSample(view.seed, pixel, sample);
  const uint32_t x = pixel % view.width, y = pixel / view.width;
  return picture.context.camera.Shoot(x + static_cast<double>(at.x), y + static_cast<double>(at.y));
}

/// A view of the scene with the lights that `quarry render` would take. Errors: as of NormalizeView().
Result<View> MakeView(const LaboratoryScene& scene, Renderer renderer, const CameraSpec& camera,
                      uint32_t width, uint32_t height, uint32_t samples);

/// The means of `sums`, three floats a pixel, row by row: the bits of a tile's pixels.
std::vector<float> MeansOf(const std::vector<PixelSum>& sums, uint32_t samples);

}  // namespace quarry::laboratory

#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// All that a picture depends on, beside the scene.
struct RenderJob {
  uint32_t width = 1024, height = 768;
  uint32_t crop_x = 0, crop_y = 0, crop_width = 0, crop_height = 0;  ///< whole image when width is 0
  RenderMode mode = RenderMode::kRaycast;
  uint32_t spp = 1;
  uint64_t seed = 0;
  double exposure = 0;         ///< EV, for PNG only
  uint32_t aov_mask = 0;       ///< bit per Aov
  std::string format = "png";  ///< png or exr
  std::vector<Light> lights;
  glm::vec3 ambient{0.2f};
  glm::vec3 background{0.55f, 0.65f, 0.8f};
  std::vector<CameraSpec> cameras;  ///< one a frame
  uint32_t first_frame = 0;         ///< the number of cameras[0]

  bool has(Aov aov) const { return aov_mask >> static_cast<int>(aov) & 1; }
};

/// Of one job: three quarters of an hour at 24 a second. A job travels as one message, and whoever listens
/// bounds what half-read messages may take.
inline constexpr uint32_t kMaxFrames = 1u << 16;

/// One frame of a job. Requires: `frame` is less than the number of cameras.
View FrameView(const RenderJob& job, size_t frame = 0);

/// "60 frames of 1024x768, whitted, 4 samples a pixel, png": for logs.
std::string Describe(const RenderJob& job);

/// Fills in a whole-image crop. Errors (usage): sizes, counts, directions or modes out of range; one
/// sentence.
Status NormalizeJob(RenderJob& job);

}  // namespace quarry

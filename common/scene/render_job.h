#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// Everything that decides the pictures of a job except the scene: one View per camera, with the settings of
/// the image files. Units: as in View.
struct RenderJob {
  uint32_t width = 1024, height = 768;
  uint32_t crop_x = 0, crop_y = 0, crop_width = 0, crop_height = 0;  ///< the whole image when the width is 0
  RenderMode mode = RenderMode::kRaycast;
  uint32_t spp = 1;
  uint64_t seed = 0;
  double exposure = 0;         ///< EV, for PNG only
  uint32_t aov_mask = 0;       ///< a bit for each Aov
  std::string format = "png";  ///< "png" or "exr"
  std::vector<Light> lights;
  glm::vec3 ambient{0.2f};
  glm::vec3 background{0.55f, 0.65f, 0.8f};
  std::vector<CameraSpec> cameras;  ///< one per frame
  uint32_t first_frame = 0;         ///< the frame number of cameras[0]

  bool has(Aov aov) const { return aov_mask >> static_cast<int>(aov) & 1; }
};

/// Limit of frames in a job: 45 minutes at 24 frames a second. A job travels as one message, and a listener
/// limits the memory of half-read messages.
inline constexpr uint32_t kMaxFrames = 1u << 16;

/// The view of a frame. Requires: a normalized job; `frame` is below the number of cameras.
View FrameView(const RenderJob& job, size_t frame = 0);

/// "60 frames of 1024x768, whitted, 4 samples a pixel, png": for logs.
std::string Describe(const RenderJob& job);

/// Checks a job, fills in the crop of a whole image and makes the directions of suns unit vectors.
/// Errors (usage): a size, count, direction or mode out of range.
Status NormalizeJob(RenderJob& job);

}  // namespace quarry

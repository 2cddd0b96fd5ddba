#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// How a picture is written to a file.
struct ImageFormat {
  std::string name = "png";        ///< png or exr
  std::optional<double> exposure;  ///< EV, for PNG only; none: metered in the job's first frame
};

/// Pictures of one scene: a view, from each of several cameras.
struct RenderJob {
  View view;                        ///< of every frame, but for its camera
  std::vector<CameraSpec> cameras;  ///< by frame
  uint32_t first_frame = 0;         ///< the number of the first camera's frame
  ImageFormat format;
};

/// Frames of one job: three quarters of an hour at 24 a second. A job travels as one message, and a listener
/// bounds the memory of half-read messages.
inline constexpr uint32_t kMaxFrames = 1u << 16;

/// One frame of a job. Requires: `frame` is less than the number of cameras.
View FrameView(const RenderJob& job, size_t frame = 0);

/// "60 frames of 1024x768, whitted, 4 samples a pixel, png": for logs.
std::string Describe(const RenderJob& job);

/// Normalizes the view. Errors (usage): as NormalizeView's; a format, exposure or number of frames is out of
/// range; one sentence, which names the frame of a bad camera.
Status NormalizeJob(RenderJob& job);

}  // namespace quarry

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
  std::string name = "png";            ///< png or exr
  std::optional<double> exposure;      ///< EV, for PNG only; none: metered in the job's first frame
  std::optional<ToneCurve> tone = {};  ///< of PNGs; none: the mode's
};

/// The tone curve of a picture of this mode. Thread-safe.
inline ToneCurve ToneOf(const ImageFormat& format, RenderMode mode) {
  return format.tone.value_or(InfoOf(mode).tone);
}

/// The pictures of a job: one view from several cameras, and the settings of the image files.
struct RenderJob {
  View view;                        ///< of every frame, except its camera
  std::vector<CameraSpec> cameras;  ///< one per frame
  uint32_t first_frame = 0;         ///< the frame number of cameras[0]
  ImageFormat format;
};

/// Limit of frames in a job: 45 minutes at 24 frames a second. A job travels as one message, and a listener
/// limits the memory of half-read messages.
inline constexpr uint32_t kMaxFrames = 1u << 16;

/// The view of a frame. Requires: a normalized job; `frame` is below the number of cameras.
View FrameView(const RenderJob& job, size_t frame = 0);

/// "60 frames of 1024x768, whitted, 4 samples a pixel, png": for logs.
std::string Describe(const RenderJob& job);
/// "4 samples a pixel", or "up to 4096 samples a pixel, to a noise of 0.05".
std::string DescribeSamples(const View& view);

/// Checks a job, fills in the crop of a whole image and makes the directions of suns unit vectors.
/// Errors (usage): a size, count, direction or mode out of range.
Status NormalizeJob(RenderJob& job);

}  // namespace quarry

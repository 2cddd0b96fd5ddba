#include "common/scene/render_job.h"

#include <fmt/format.h>

#include <cmath>

namespace quarry {

std::string Describe(const RenderJob& job) {
  const auto plural = [](size_t n) { return n == 1 ? "" : "s"; };
  return fmt::format("{} frame{} of {}x{}, {}, {}, {}", job.cameras.size(), plural(job.cameras.size()),
                     job.view.width, job.view.height, InfoOf(job.view.mode).name, DescribeSamples(job.view),
                     job.format.name);
}

std::string DescribeSamples(const View& view) {
  if (view.noise > 0) return fmt::format("up to {} samples a pixel, to a noise of {}", view.spp, view.noise);
  return fmt::format("{} sample{} a pixel", view.spp, view.spp == 1 ? "" : "s");
}

View FrameView(const RenderJob& job, size_t frame) {
  View view = job.view;
  view.camera = job.cameras[frame];
  PlaceEyeLights(view);
  return view;
}

Status NormalizeJob(RenderJob& job) {
  QUARRY_TRY(NormalizeView(job.view));
  if (const double ev = job.format.exposure.value_or(0); !std::isfinite(ev) || std::fabs(ev) > 100)
    return BadUsage("--exposure must lie within 100");
  if (job.format.name != "png" && job.format.name != "exr")
    return BadUsage("images are written as .png or .exr");
  if (job.cameras.empty() || job.cameras.size() > kMaxFrames)
    return BadUsage(fmt::format("between 1 and {} frames can be rendered", kMaxFrames));
  for (size_t i = 0; i < job.cameras.size(); ++i)
    if (Status right = CheckCamera(job.cameras[i]); !right) {
      if (job.cameras.size() == 1 && job.first_frame == 0) return right;
      return BadUsage(fmt::format("frame {}: {}", job.first_frame + i, right.error().message));
    }
  return {};
}

}  // namespace quarry

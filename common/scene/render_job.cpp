#include "common/scene/render_job.h"

#include <fmt/format.h>

#include <cmath>

namespace quarry {
namespace {

template <class V>
bool Finite(const V& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

template <class V>
bool Nonnegative(const V& v) {
  return Finite(v) && v.x >= 0 && v.y >= 0 && v.z >= 0;
}

Status CheckCamera(const CameraSpec& c) {
  if (!Finite(c.eye) || !Finite(c.at) || !Finite(c.up))
    return BadUsage("the camera has a coordinate that is no number");
  const glm::dvec3 view = c.at - c.eye;
  const glm::dvec3 side{view.y * c.up.z - view.z * c.up.y, view.z * c.up.x - view.x * c.up.z,
                        view.x * c.up.y - view.y * c.up.x};
  if (view == glm::dvec3(0)) return BadUsage("the camera's eye and the point it looks at are the same");
  if (side == glm::dvec3(0)) return BadUsage("the camera looks along its up vector; give another --up");
  if (c.ortho_height < 0 || !std::isfinite(c.ortho_height))
    return BadUsage("--ortho needs a positive height");
  if (!(c.fov_degrees > 0) || c.fov_degrees > 179)
    return BadUsage("--fov must lie between 0 and 179 degrees");
  return {};
}

}  // namespace

std::string Describe(const RenderJob& job) {
  const auto plural = [](size_t n) { return n == 1 ? "" : "s"; };
  return fmt::format("{} frame{} of {}x{}, {}, {} sample{} a pixel, {}", job.cameras.size(),
                     plural(job.cameras.size()), job.width, job.height,
                     kRenderModeNames[static_cast<size_t>(job.mode)], job.spp, plural(job.spp), job.format);
}

View FrameView(const RenderJob& job, size_t frame) {
  View view;
  view.width = job.width;
  view.height = job.height;
  view.crop_x = job.crop_x;
  view.crop_y = job.crop_y;
  view.crop_width = job.crop_width;
  view.crop_height = job.crop_height;
  view.mode = job.mode;
  view.spp = job.spp;
  view.seed = job.seed;
  view.aov_mask = job.aov_mask;
  view.lights = job.lights;
  view.ambient = job.ambient;
  view.background = job.background;
  view.camera = job.cameras[frame];
  return view;
}

uint32_t WordsPerPixel(uint32_t aov_mask) {
  uint32_t words = 3;
  for (int a = 0; a < kAovs; ++a)
    if (aov_mask >> a & 1) words += static_cast<uint32_t>(kAovInfo[a].words);
  return words;
}

Status NormalizeJob(RenderJob& job) {
  if (job.width == 0 || job.height == 0 || job.width > kMaxImageSide || job.height > kMaxImageSide)
    return BadUsage(fmt::format("the image size {}x{} must lie between 1 and {} a side", job.width,
                                job.height, kMaxImageSide));
  if (job.crop_width == 0) {
    job.crop_x = job.crop_y = 0;
    job.crop_width = job.width;
    job.crop_height = job.height;
  }
  if (job.crop_height == 0 || job.crop_x >= job.width || job.crop_y >= job.height ||
      job.crop_width > job.width - job.crop_x || job.crop_height > job.height - job.crop_y)
    return BadUsage("--crop must lie within the image");
  if (static_cast<uint8_t>(job.mode) >= kRenderModes) return BadUsage("that mode is not known");
  if (job.spp == 0 || job.spp > kMaxSpp)
    return BadUsage(fmt::format("--spp must lie between 1 and {}", kMaxSpp));
  if (!std::isfinite(job.exposure) || std::fabs(job.exposure) > 100)
    return BadUsage("--exposure must lie within 100");
  if (job.aov_mask >> kAovs) return BadUsage("an unknown layer was asked for");
  if (job.format != "png" && job.format != "exr") return BadUsage("images are written as .png or .exr");
  if (job.lights.size() > kMaxLights) return BadUsage(fmt::format("more than {} lights", kMaxLights));
  for (Light& light : job.lights) {
    if (!Finite(light.vector) || !Nonnegative(light.radiance) || !Finite(light.axis) ||
        !std::isfinite(light.cone_scale) || !std::isfinite(light.cone_offset))
      return BadUsage("a light has a value that cannot be");
    if (light.kind != LightKind::kSun) continue;
    const float length = std::sqrt(light.vector.x * light.vector.x + light.vector.y * light.vector.y +
                                   light.vector.z * light.vector.z);
    if (!(length > 1e-18f) || !(length < 1e18f)) return BadUsage("the sun has no direction");
    // Each program that a job passes through comes here: once done, it must not move the last bit again.
    if (std::fabs(length - 1) > 1e-6f) light.vector /= length;
  }
  if (!Nonnegative(job.ambient) || !Nonnegative(job.background))
    return BadUsage("ambient and background must be >= 0");
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

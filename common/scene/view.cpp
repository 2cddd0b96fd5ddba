#include "common/scene/view.h"

#include <fmt/format.h>

#include <cmath>

#include "common/scene/sky/atmosphere.h"

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

Status CheckSky(const View& view) {
  const Sky& sky = view.sky;
  if (!Nonnegative(sky.radiance)) return BadUsage("the sky's radiance must be >= 0");
  if (sky.turbidity == 0 && sky.haze == 0) return {};
  if (sky.haze != 0 && sky.radiance != glm::vec3(0))
    return BadUsage("a sky has one radiance or an atmosphere, not both");
  if (sky.turbidity != 0 && sky.haze != 0)
    return BadUsage("a view has one sky: a clear one, or an atmosphere");
  if (sky.haze != 0 && !(sky.haze >= kLeastHaze && sky.haze <= kMostHaze))
    return BadUsage(fmt::format("--atmosphere, a haze, must lie between {} and {}", kLeastHaze, kMostHaze));
  if (sky.turbidity != 0 && !(sky.turbidity >= kLeastTurbidity && sky.turbidity <= kMostTurbidity))
    return BadUsage(
        fmt::format("--sky, a turbidity, must lie between {} and {}", kLeastTurbidity, kMostTurbidity));
  for (const Light& light : view.lights)
    if (light.kind == LightKind::kSun) return {};
  return BadUsage("a clear sky or an atmosphere needs a sun; add one with --sun");
}

/// Other modes have no use for an environment.
Status NormalizeEnvironment(View& view) {
  if (view.mode != RenderMode::kPath) view.environment = {};
  const ViewEnvironment& e = view.environment;
  if (!e.is_named()) return {};
  if (!std::isfinite(e.turn) || std::fabs(e.turn) > kMostTurn)
    return BadUsage(fmt::format("the environment's turn must lie between -{0} and {0} degrees", kMostTurn));
  if (!(e.strength > 0 && e.strength <= kMostStrength))
    return BadUsage(fmt::format("the environment's strength must lie above 0, at most {}", kMostStrength));
  if (view.sky.shines()) return BadUsage("a view has one sky: a clear one, an atmosphere, or an environment");
  return {};
}

}  // namespace

Status CheckCamera(const CameraSpec& c) {
  if (!Finite(c.eye) || !Finite(c.at) || !Finite(c.up))
    return BadUsage("the camera has a coordinate that is not a number");
  const glm::dvec3 view = c.at - c.eye;
  const glm::dvec3 side{view.y * c.up.z - view.z * c.up.y, view.z * c.up.x - view.x * c.up.z,
                        view.x * c.up.y - view.y * c.up.x};
  if (view == glm::dvec3(0)) return BadUsage("the camera's eye and the point it looks at are the same");
  if (side == glm::dvec3(0)) return BadUsage("the camera looks along its up vector; give another --up");
  if (c.ortho_height < 0 || !std::isfinite(c.ortho_height))
    return BadUsage("--ortho needs a positive height");
  if (!(c.fov_degrees > 0) || c.fov_degrees > 179)
    return BadUsage("--fov must lie between 0 and 179 degrees");
  if (!(c.aperture >= 0 && c.aperture <= kMostLens))
    return BadUsage("--aperture must be a length of 0 or more");
  if (!(c.focus >= 0 && c.focus <= kMostLens)) return BadUsage("--focus must be a distance of 0 or more");
  return {};
}

uint32_t WordsPerPixel(uint32_t aov_mask) {
  uint32_t words = kColorWords;
  for (int a = 0; a < kAovs; ++a)
    if (aov_mask >> a & 1) words += static_cast<uint32_t>(kAovInfo[a].words);
  return words;
}

bool HasArea(const glm::vec3 (&edges)[2]) {
  const glm::dvec3 a(edges[0]), b(edges[1]);
  const glm::dvec3 cross{a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
  const double area = std::sqrt(cross.x * cross.x + cross.y * cross.y + cross.z * cross.z);
  const double sides = std::sqrt((a.x * a.x + a.y * a.y + a.z * a.z) * (b.x * b.x + b.y * b.y + b.z * b.z));
  return area > 1e-30 && area < 1e30 && area > 1e-6 * sides;
}

void PlaceEyeLights(View& view) {
  for (Light& light : view.lights)
    if (light.kind == LightKind::kPoint && light.at_eye) light.vector = glm::vec3(view.camera.eye);
}

Status NormalizeView(View& view) {
  if (view.width == 0 || view.height == 0 || view.width > kMaxImageSide || view.height > kMaxImageSide)
    return BadUsage(fmt::format("the image size {}x{} must lie between 1 and {} a side", view.width,
                                view.height, kMaxImageSide));
  if (view.crop.width == 0) view.crop = {0, 0, view.width, view.height};
  if (view.crop.height == 0 || view.crop.x >= view.width || view.crop.y >= view.height ||
      view.crop.width > view.width - view.crop.x || view.crop.height > view.height - view.crop.y)
    return BadUsage("--crop must lie within the image");
  if (static_cast<uint8_t>(view.mode) >= kRenderModes) return BadUsage("the mode is unknown");
  if (view.spp == 0 || view.spp > kMaxSpp)
    return BadUsage(fmt::format("--spp must lie between 1 and {}", kMaxSpp));
  if (view.noise != 0 && !(view.noise >= kLeastNoise && view.noise <= kMostNoise))
    return BadUsage(fmt::format("--noise must lie between {} and {}", kLeastNoise, kMostNoise));
  if (view.noise > 0 && view.spp < kLeastNoiseSpp)
    return BadUsage(fmt::format("--noise needs at least {} samples a pixel; give another --spp, or none",
                                kLeastNoiseSpp));
  if (view.has(Aov::kNoise) && view.spp < 2)
    return BadUsage("the layer noise needs at least 2 samples a pixel; give --spp");
  if (view.up_axis > 2) return BadUsage("the up axis is unknown");
  if (view.ao_samples == 0 || view.ao_samples > kMaxAoSamples)
    return BadUsage(fmt::format("--ao-samples must lie between 1 and {}", kMaxAoSamples));
  if (!std::isfinite(view.ao_distance) || view.ao_distance < 0)
    return BadUsage("--ao-distance must be a positive length");
  if (view.bounces > kMaxBounces)
    return BadUsage(fmt::format("--bounces must lie between 0 and {}", kMaxBounces));
  QUARRY_TRY(CheckSky(view));
  QUARRY_TRY(NormalizeEnvironment(view));
  if (std::abs(view.range) > kMostRange) return BadUsage("a view's range is too large");
  if (view.aov_mask >> kAovs) return BadUsage("an unknown layer was requested");
  if (view.lights.size() > kMaxLights) return BadUsage(fmt::format("more than {} lights", kMaxLights));
  if (view.transparent) view.backdrop = true;
  PlaceEyeLights(view);
  for (Light& light : view.lights) {
    if (!Finite(light.vector) || !Nonnegative(light.radiance) || !Finite(light.axis) ||
        !std::isfinite(light.cone_scale) || !std::isfinite(light.cone_offset) ||
        !(light.angle >= 0 && light.angle <= 90) || !(light.radius >= 0 && light.radius <= 1e18f) ||
        !Finite(light.edges[0]) || !Finite(light.edges[1]))
      return BadUsage("a light has an invalid value");
    if (light.kind == LightKind::kRectangle && !HasArea(light.edges))
      return BadUsage("a rectangle that shines has no area");
    if (light.kind != LightKind::kSun) continue;
    const float length = std::sqrt(light.vector.x * light.vector.x + light.vector.y * light.vector.y +
                                   light.vector.z * light.vector.z);
    if (!(length > 1e-18f) || !(length < 1e18f)) return BadUsage("the sun has no direction");
    // Every program that a view passes through normalizes it; a second normalization must not change the last
    // bit.
    if (std::fabs(length - 1) > 1e-6f) light.vector /= length;
  }
  if (!Nonnegative(view.ambient) || !Nonnegative(view.background))
    return BadUsage("ambient and background must be >= 0");
  QUARRY_TRY(NormalizeSection(view.section));
  return CheckCamera(view.camera);
}

}  // namespace quarry

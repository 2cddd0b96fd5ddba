#include "master/pictures/exposure_meter.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "common/math/elementary.h"

namespace quarry {
namespace {

/// EV above white of bright points that film's curve still shows well.
constexpr double kFilmWhite = 3;
/// Of so many points one may be clipped.
constexpr size_t kClippedOf = 128;
/// Lattice points along the image's longer side.
constexpr uint32_t kLattice = 64;
/// Samples of each where light bounces: one is too noisy.
constexpr uint32_t kBouncedSamples = 16;

/// Textures of an emission are mostly black, so that their materials are no lamps.
bool Emits(const Material& m) {
  const auto is_emission = [](const TextureBinding& b) { return b.use == TextureUse::kEmission; };
  return !m.unlit && m.emission != glm::vec3(0) && std::ranges::none_of(m.textures, is_emission);
}

}  // namespace

View MeteredView(View view) {
  view.crop = {0, 0, view.width, view.height};
  view.spp = InfoOf(view.mode).bounces ? kBouncedSamples : 1;
  view.meters = InfoOf(view.mode).bounces;
  view.edges = false;
  view.noise = 0;  // its samples are few
  view.aov_mask = 1u << static_cast<int>(Aov::kDepth) | 1u << static_cast<int>(Aov::kMaterial);
  return view;
}

Tile MeteredTile(const View& view) {
  return {{0, 0, view.width, view.height}, (std::max(view.width, view.height) + kLattice - 1) / kLattice};
}

void AddMeteredPoints(std::span<const std::byte> pixels, std::span<const Material> materials,
                      std::vector<MeteredPoint>& points) {
  struct Pixel {
    float color[3], coverage, depth;
    uint32_t material;
  };
  for (Pixel p; pixels.size() >= sizeof p; pixels = pixels.subspan(sizeof p)) {
    std::memcpy(&p, pixels.data(), sizeof p);
    if (p.coverage == 0) continue;  // the backdrop is not exposed
    const auto& [r, g, b] = p.color;
    const bool surface = std::isfinite(p.depth);
    points.push_back({0.2126f * r + 0.7152f * g + 0.0722f * b, std::max({r, g, b}), surface,
                      surface && p.material < materials.size() && Emits(materials[p.material])});
  }
}

double ExposureFor(std::span<const MeteredPoint> points, int range, ToneCurve tone) {
  const double least = std::ldexp(1e-6, -range);
  std::vector<double> logarithms;
  std::vector<float> largest;
  const auto is_lit = [](const MeteredPoint& p) { return p.surface && !p.emits && p.luminance > 0; };
  const bool others = std::ranges::any_of(points, is_lit);
  for (const MeteredPoint& point : points) {
    if (point.emits && others) continue;
    largest.push_back(point.largest);
    if (point.surface && point.luminance > 0)
      logarithms.push_back(Log2(std::max(static_cast<double>(point.luminance), least)));
  }
  if (logarithms.empty()) return 0;
  std::ranges::sort(logarithms);  // one order of the sum, whatever the order of points
  double sum = 0;
  for (const double logarithm : logarithms) sum += logarithm;
  const auto bright =
      largest.begin() + static_cast<std::ptrdiff_t>(largest.size() - 1 - largest.size() / kClippedOf);
  std::ranges::nth_element(largest, bright);
  const double headroom = tone == ToneCurve::kFilm ? kFilmWhite : 0;
  const double ev = std::min(Log2(kMeteredGrey) - sum / static_cast<double>(logarithms.size()),
                             headroom - Log2(std::max(static_cast<double>(*bright), least)));
  return std::clamp(std::floor(ev * 64) / 64, -16.0 + range, 16.0 + range);
}

}  // namespace quarry

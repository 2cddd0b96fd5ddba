#include "tests/laboratory/machine/raster.h"

#include <algorithm>
#include <cmath>
#include <glm/geometric.hpp>
#include <limits>

#include "common/kdtree/trace/triangle_test.h"
#include "common/math/next_float.h"
#include "common/scene/view_basis.h"

namespace quarry::laboratory {

namespace {

/// Pixels from (x0, y0) to before (x1, y1).
struct Area {
  uint32_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;
};

/// Where triangles lie in the image.
class Projection {
 public:
  explicit Projection(const View& view)
      : basis_(MakeViewBasis(view.camera, view.height)), width_(view.width), height_(view.height) {}

  /// Pixels that the triangle may cover, a pixel to spare on each side. A triangle that reaches behind the
  /// eye may cover all.
  Area AreaOf(const KdTriangle& triangle) const {
    double lower[2] = {1e300, 1e300}, upper[2] = {-1e300, -1e300};
    int ahead = 0;
    for (const glm::vec3& vertex : triangle.vertices) {
      const glm::dvec3 to = glm::dvec3(vertex) - basis_.eye;
      const double depth = glm::dot(to, basis_.forward);
      if (!basis_.orthographic && !(depth > 1e-6 * glm::length(to))) continue;
      ++ahead;
      const double scale = basis_.orthographic ? 1 : 1 / depth;
      const double at[2] = {
          width_ / 2 + scale * glm::dot(to, basis_.right) / glm::dot(basis_.right, basis_.right),
          height_ / 2 + scale * glm::dot(to, basis_.down) / glm::dot(basis_.down, basis_.down)};
      for (int a = 0; a < 2; ++a) {
        lower[a] = std::min(lower[a], at[a]);
        upper[a] = std::max(upper[a], at[a]);
      }
    }
    if (ahead == 0 && !Straddles(triangle)) return {};
    if (ahead < 3) return {0, 0, static_cast<uint32_t>(width_), static_cast<uint32_t>(height_)};
    return {Clamp(lower[0] - 2, width_), Clamp(lower[1] - 2, height_), Clamp(upper[0] + 2, width_),
            Clamp(upper[1] + 2, height_)};
  }

 private:
  /// Whether a part of the triangle may lie just before the eye.
  bool Straddles(const KdTriangle& triangle) const {
    double most = -1e300, size = 0;
    for (const glm::vec3& vertex : triangle.vertices) {
      const glm::dvec3 to = glm::dvec3(vertex) - basis_.eye;
      most = std::max(most, glm::dot(to, basis_.forward));
      size = std::max(size, glm::length(to));
    }
    return most >= -1e-5 * size;
  }
  static uint32_t Clamp(double at, double most) { return static_cast<uint32_t>(std::clamp(at, 0.0, most)); }

  ViewBasis basis_;
  double width_, height_;
};

}  // namespace

std::vector<HitState> Rasterize(const Picture& picture, std::span<const uint32_t> pixels, uint32_t sample) {
  constexpr uint32_t kNowhere = std::numeric_limits<uint32_t>::max();
  const View& view = picture.context.view;
  std::vector<uint32_t> place(picture.pixels(), kNowhere);
  std::vector<RayFrame<ScalarLane>> frames(pixels.size());
  std::vector<Hit> hits(pixels.size());
  for (uint32_t i = 0; i < pixels.size(); ++i) {
    const uint32_t pixel = pixels[i];
    place[pixel] = i;
    const PrimaryRay eye = EyeRayOf(picture, pixel, sample);
    Ray ray;
    ray.origin = eye.origin;
    ray.direction = eye.direction;
    frames[i] = MakeRayFrame(ray);
    hits[i].t = NextBelow(kInfinity);
  }
  const Projection projection(view);
  const std::vector<KdTriangle>& triangles = picture.scene.triangles();
  for (uint32_t t = 0; t < triangles.size(); ++t) {
    const Area area = projection.AreaOf(triangles[t]);
    for (uint32_t y = area.y0; y < area.y1; ++y)
      for (uint32_t x = area.x0; x < area.x1; ++x) {
        const uint32_t i = place[y * view.width + x];
        if (i == kNowhere) continue;
        const auto& p = triangles[t].vertices;
        TestTriangle(frames[i], p[0], p[1], p[2], t, hits[i]);
      }
  }
  std::vector<HitState> out;
  out.reserve(hits.size());
  for (const Hit& hit : hits) out.push_back({hit.t, hit.b1, hit.b2, hit.triangle});
  return out;
}

}  // namespace quarry::laboratory

#include "master/schedule/reprojection.h"

#include <algorithm>
#include <cmath>

namespace quarry {

void PixelBounds::Include(double x, double y) {
  x0 = std::min(x0, x);
  y0 = std::min(y0, y);
  x1 = std::max(x1, x);
  y1 = std::max(y1, y);
}

Reprojection::Reprojection(const View& from, const View& to)
    : from_(from),
      to_(to),
      from_view_(MakeViewBasis(from.camera, from.height)),
      to_view_(MakeViewBasis(to.camera, to.height)) {}

glm::dvec3 Reprojection::PointAt(double x, double y, double depth) const {
  const ViewBasis& view = from_view_;
  const glm::dvec3 across = view.right * (x - from_.width / 2.0) + view.down * (y - from_.height / 2.0);
  if (view.orthographic) return view.eye + across + view.forward * depth;
  return view.eye + Unit(view.forward + across) * depth;
}

bool Reprojection::Project(const glm::dvec3& point, double& x, double& y) const {
  const ViewBasis& view = to_view_;
  const glm::dvec3 v = point - view.eye;
  const double ahead = Dot(v, view.forward);
  if (ahead <= 0) return false;
  const double scale = (view.orthographic ? 1 : ahead) * Dot(view.right, view.right);
  x = Dot(v, view.right) / scale + to_.width / 2.0;
  y = Dot(v, view.down) / scale + to_.height / 2.0;
  return true;
}

bool Reprojection::Rectangle(const PixelRect& pixels, double depth, PixelBounds& bounds) const {
  bool any = false;
  for (int corner = 0; corner < 4; ++corner) {
    const double x = pixels.x + (corner & 1 ? pixels.width : 0);
    const double y = pixels.y + (corner & 2 ? pixels.height : 0);
    double px = 0, py = 0;
    if (!Project(PointAt(x, y, std::min(depth, kFarAway)), px, py)) continue;
    bounds.Include(px, py);
    any = true;
  }
  return any;
}

PixelGrid::PixelGrid(const std::vector<PixelRect>& tiles, uint32_t side) : side_(side) {
  for (const PixelRect& tile : tiles) {
    x0_ = std::min(x0_, tile.x);
    y0_ = std::min(y0_, tile.y);
  }
  for (const PixelRect& tile : tiles) {
    columns_ = std::max(columns_, (tile.x - x0_ + tile.width - 1) / side_ + 1);
    rows_ = std::max(rows_, (tile.y - y0_ + tile.height - 1) / side_ + 1);
  }
}

uint32_t PixelGrid::Clamp(double pixels, uint32_t count) const {
  return static_cast<uint32_t>(std::clamp(pixels / side_, 0.0, count - 1.0));
}

double PixelGrid::Covered(const PixelBounds& r, double x, double y) const {
  return std::max(0.0, std::min(r.x1, x + side_) - std::max(r.x0, x)) *
         std::max(0.0, std::min(r.y1, y + side_) - std::max(r.y0, y));
}

}  // namespace quarry

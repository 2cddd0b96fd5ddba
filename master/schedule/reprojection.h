#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "common/scene/view.h"
#include "common/scene/view_basis.h"
#include "master/pictures/frame_image.h"

namespace quarry {

/// Depth of a ray that hits nothing: so far that only its direction matters. Units: scene units.
inline constexpr double kFarAway = 1e9;

/// Bounds of projected points. Units: pixels, fractions included; empty until a point is included.
struct PixelBounds {
  double x0 = 1e300, y0 = 1e300, x1 = -1e300, y1 = -1e300;
  void Include(double x, double y);
  double area() const { return (x1 - x0) * (y1 - y0); }
};

/// Maps rectangles of one camera's image to another camera's. Reads the views' cameras and sizes only.
/// Units: pixels; depth in scene units along the ray. Thread-safe.
class Reprojection {
 public:
  /// The views must outlive this.
  Reprojection(const View& from, const View& to);

  /// Where `to` sees a rectangle of `from` that is `depth` away. False: the rectangle is behind the eye.
  bool Rectangle(const PixelRect& pixels, double depth, PixelBounds& bounds) const;

 private:
  glm::dvec3 PointAt(double x, double y, double depth) const;
  bool Project(const glm::dvec3& point, double& x, double& y) const;

  const View &from_, &to_;
  const ViewBasis from_view_, to_view_;
};

/// The squares that an image, or a crop of it, is cut into, by place. Units: pixels. Thread-safe.
class PixelGrid {
 public:
  PixelGrid(const std::vector<PixelRect>& tiles, uint32_t side);

  uint32_t columns() const { return columns_; }
  uint32_t rows() const { return rows_; }
  size_t size() const { return size_t{columns_} * rows_; }
  /// Index of the square that has the pixel. Requires: the pixel is in the crop.
  size_t At(uint32_t x, uint32_t y) const { return size_t{(y - y0_) / side_} * columns_ + (x - x0_) / side_; }

  /// Calls `use(square, pixels)` for every square near the bounds, with the pixels of it that they cover.
  template <class Use>
  void Each(const PixelBounds& r, Use&& use) const {
    const uint32_t c0 = Clamp(r.x0 - x0_, columns_), c1 = Clamp(r.x1 - x0_, columns_);
    const uint32_t r0 = Clamp(r.y0 - y0_, rows_), r1 = Clamp(r.y1 - y0_, rows_);
    for (uint32_t row = r0; row <= r1; ++row)
      for (uint32_t column = c0; column <= c1; ++column)
        use(size_t{row} * columns_ + column, Covered(r, x0_ + column * side_, y0_ + row * side_));
  }

 private:
  uint32_t Clamp(double pixels, uint32_t count) const;
  double Covered(const PixelBounds& r, double x, double y) const;

  const uint32_t side_;
  uint32_t x0_ = ~0u, y0_ = ~0u, columns_ = 1, rows_ = 1;
};

}  // namespace quarry

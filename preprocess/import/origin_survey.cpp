#include "preprocess/import/origin_survey.h"

#include <algorithm>
#include <cmath>

namespace quarry {
namespace {

constexpr double kMostCoordinate = 0x1p60;

bool IsPlace(const glm::dvec3& p) {
  return std::fabs(p.x) <= kMostCoordinate && std::fabs(p.y) <= kMostCoordinate &&
         std::fabs(p.z) <= kMostCoordinate;
}

double Extent(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c) {
  double extent = 0;
  for (int axis = 0; axis < 3; ++axis)
    extent = std::max(extent, std::max({a[axis], b[axis], c[axis]}) - std::min({a[axis], b[axis], c[axis]}));
  return extent;
}

}  // namespace

Status OriginSurvey::AddPosition(const glm::dvec3& position, const Rgba8&) {
  if (positions_.size() == kMost) return Fail("enough");
  positions_.push_back(position);
  return {};
}

Status OriginSurvey::AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) {
  if (corners.size() < 3) return {};
  if (faces_.size() == kMost) return Fail("enough");
  faces_.push_back({{corners[0].position, corners[1].position, corners[2].position}});
  return {};
}

std::vector<OriginSurvey::Weighed> OriginSurvey::Triangles() const {
  std::vector<Weighed> triangles;
  std::vector<double> extents;
  for (const Face& face : faces_) {
    if (std::max({face.corners[0], face.corners[1], face.corners[2]}) >= positions_.size()) continue;
    const glm::dvec3 &a = positions_[face.corners[0]], &b = positions_[face.corners[1]],
                     &c = positions_[face.corners[2]];
    const double extent = Extent(a, b, c);
    if (!IsPlace(a) || !IsPlace(b) || !IsPlace(c) || extent == 0) continue;
    triangles.push_back({(a + b + c) / 3.0, extent});
    extents.push_back(extent);
  }
  if (triangles.empty()) return triangles;
  // Slivers and dust weigh at most a hundredth of the median extent.
  const auto middle = extents.begin() + static_cast<std::ptrdiff_t>(extents.size() / 2);
  std::ranges::nth_element(extents, middle);
  for (Weighed& t : triangles) t.weight = 1 / std::max(t.weight, *middle / 100);
  return triangles;
}

std::optional<glm::dvec3> OriginSurvey::Place() const {
  std::vector<Weighed> places = Triangles();
  if (places.empty())
    for (const glm::dvec3& p : positions_)
      if (IsPlace(p)) places.push_back({p, 1});
  if (places.empty()) return std::nullopt;
  double all = 0;
  for (const Weighed& p : places) all += p.weight;
  glm::dvec3 median;
  for (int axis = 0; axis < 3; ++axis) {
    std::ranges::sort(places,
                      [axis](const Weighed& a, const Weighed& b) { return a.place[axis] < b.place[axis]; });
    double before = 0;
    for (const Weighed& p : places) {
      median[axis] = p.place[axis];
      before += p.weight;
      if (before >= all / 2) break;
    }
  }
  return median;
}

}  // namespace quarry

#include "preprocess/ingest/scene_coordinates.h"

#include <cmath>
#include <glm/matrix.hpp>

namespace quarry {

void SceneCoordinates::Place(const Placement& placement, int up_axis) {
  const double angle = placement.turn_degrees * 3.14159265358979323846 / 180;
  const double c = std::cos(angle) * placement.scale, s = std::sin(angle) * placement.scale;
  const int a = (up_axis + 1) % 3, b = (up_axis + 2) % 3;
  placed_ = true;
  turn_ = glm::dmat3(placement.scale);
  turn_[a][a] = turn_[b][b] = c;
  turn_[a][b] = s;
  turn_[b][a] = -s;
  translation_ = placement.translation;
}

// The cube root of the factor on volumes.
double SceneCoordinates::UnitLength() const { return scale_ * std::cbrt(glm::determinant(turn_)); }

void SceneCoordinates::ChooseOffset(const glm::dvec3& point) {
  constexpr double kFar = 16384, kStep = 1024, kMost = 0x1p60;
  has_offset_ = false;
  glm::dvec3 offset(0);
  for (int a = 0; a < 3; ++a) {
    if (!(std::fabs(point[a]) <= kMost)) return;
    if (std::fabs(point[a]) >= kFar) offset[a] = std::round(point[a] / kStep) * kStep;
  }
  offset_ = offset;
  has_offset_ = true;
}

glm::vec3 SceneCoordinates::Store(const glm::dvec3& position) {
  const glm::dvec3 point = Point(position);
  if (!has_offset_) ChooseOffset(point);
  const glm::dvec3 exact = point - offset_;
  const glm::vec3 stored(exact);
  for (int a = 0; a < 3; ++a) {
    const double loss = std::fabs(exact[a] - stored[a]);
    if (loss > largest_loss_) largest_loss_ = loss;
  }
  return stored;
}

void SceneCoordinates::Save(ByteWriter& out) const {
  out.Put<uint8_t>(has_offset_);
  out.PutVec3(offset_);
  out.Put(largest_loss_);
}

void SceneCoordinates::Restore(ByteReader& in) {
  has_offset_ = in.Get<uint8_t>() != 0;
  offset_ = in.GetVec3<glm::dvec3>();
  largest_loss_ = in.Get<double>();
}

}  // namespace quarry

#pragma once

#include <glm/mat3x3.hpp>
#include <glm/vec3.hpp>

#include "common/base/bytes.h"

namespace quarry {

/// Where a model stands in the scene: scaled, turned counter-clockwise about the up axis, then moved.
/// Units: translation in the models' units, before --scale.
struct Placement {
  double scale = 1, turn_degrees = 0;
  glm::dvec3 translation{0};
};

/// Maps a model's coordinates to the scene's, and to the floats that a store holds.
/// A float keeps a position to 2^-24 of its distance from the origin, so a scene that lies far out is moved
/// near the origin by an offset, which is chosen once, before the first position is stored.
/// Units: model units in, scene units out. Thread safety: none.
class SceneCoordinates {
 public:
  explicit SceneCoordinates(double scale) : scale_(scale) {}

  /// Sets the placement of the models that follow. Requires: up_axis is 1 (y) or 2 (z).
  void Place(const Placement& placement, int up_axis);

  glm::dvec3 Point(const glm::dvec3& position) const {
    return (placed_ ? turn_ * position + translation_ : position) * scale_;
  }
  /// Turned, and scaled by the placement alone.
  glm::dvec3 Direction(const glm::dvec3& direction) const { return placed_ ? turn_ * direction : direction; }
  /// Scene length of a model's unit length.
  double UnitLength() const;

  bool has_offset() const { return has_offset_; }
  const glm::dvec3& offset() const { return offset_; }
  /// Chooses the offset from a point (after Point()) in the midst of the scene: whole steps of 1,024 along
  /// each axis on which the point is 16,384 or farther out. A point that is not finite chooses nothing.
  void ChooseOffset(const glm::dvec3& point);
  /// The position as the store holds it: Point() less the offset, rounded to floats. Chooses the offset if
  /// there is none.
  glm::vec3 Store(const glm::dvec3& position);
  /// Largest difference that Store()'s rounding has made to a coordinate, in scene units.
  double largest_loss() const { return largest_loss_; }

  /// The offset and the loss, for a checkpoint.
  void Save(ByteWriter& out) const;
  void Restore(ByteReader& in);

 private:
  double scale_;
  bool placed_ = false;
  glm::dmat3 turn_{1};  ///< the placement's rotation and scale
  glm::dvec3 translation_{0};
  bool has_offset_ = false;
  glm::dvec3 offset_{0};
  double largest_loss_ = 0;
};

}  // namespace quarry

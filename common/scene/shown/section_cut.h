#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// A plane of a section. The side that the normal points to is cut off.
struct SectionPlane {
  glm::dvec3 point{0};         ///< scene units
  glm::dvec3 normal{0, 0, 1};  ///< of unit length in a normalized section
  bool operator==(const SectionPlane&) const = default;
};

/// The part of a model that a view shows: the inside of a box, and the side of each plane that is against its
/// normal. Rays of every kind end at the cut, and lights beyond it shine in.
/// Units: scene units, without the offset of the model.
struct SectionCut {
  bool has_box = false;
  glm::dvec3 lower{0}, upper{0};  ///< the box
  std::vector<SectionPlane> planes;
  /// Whether cut solids are closed by caps: where the first hit behind the cut is the inner side of a closed
  /// part, the cut itself is drawn.
  bool caps = true;

  bool empty() const { return !has_box && planes.empty(); }
  bool operator==(const SectionCut&) const = default;
};

/// Limit of the planes of a section, the box apart.
inline constexpr uint32_t kMaxSectionPlanes = 12;

/// Checks a section and makes its normals unit vectors. An unused box and unused caps get their defaults, so
/// that equal sections compare equal.
/// Errors (usage): a number that is not finite; a box without volume; a normal of length 0; too many planes.
Status NormalizeSection(SectionCut& section);

}  // namespace quarry

#include "common/scene/shown/section_cut.h"

#include <fmt/format.h>

#include <cmath>
#include <glm/geometric.hpp>

namespace quarry {
namespace {

bool IsFinite(const glm::dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

Status CheckBox(const SectionCut& section) {
  if (!IsFinite(section.lower) || !IsFinite(section.upper))
    return BadUsage("the section's box has a coordinate that is not a number");
  for (int a = 0; a < 3; ++a)
    if (!(section.lower[a] < section.upper[a]))
      return BadUsage(fmt::format("the section's box is empty: its lower {} is not below its upper {}",
                                  "xyz"[a], "xyz"[a]));
  return {};
}

}  // namespace

Status NormalizeSection(SectionCut& section) {
  if (section.empty()) section = {};
  if (section.planes.size() > kMaxSectionPlanes)
    return BadUsage(fmt::format("the section has {} planes, and at most {} are possible",
                                section.planes.size(), kMaxSectionPlanes));
  if (section.has_box) {
    QUARRY_TRY(CheckBox(section));
  } else {
    section.lower = section.upper = {};
  }
  for (size_t i = 0; i < section.planes.size(); ++i) {
    SectionPlane& plane = section.planes[i];
    if (!IsFinite(plane.point) || !IsFinite(plane.normal))
      return BadUsage(fmt::format("plane {} of the section has a value that is not a number", i + 1));
    const double length = glm::length(plane.normal);
    if (!(length > 1e-150) || !(length < 1e150))
      return BadUsage(fmt::format("plane {} of the section has no direction: its normal is 0", i + 1));
    // A second normalization must not change the last bit.
    if (std::fabs(length - 1) > 1e-12) plane.normal /= length;
  }
  return {};
}

}  // namespace quarry

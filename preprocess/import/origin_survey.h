#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/import/ignoring_sink.h"

namespace quarry {

/// Finds a point in the midst of a model from its beginning, at most 65,536 vertices and as many faces: the
/// median of its triangles, weighted toward small triangles, which floats lose first; before the first face,
/// the median of the vertices. A few far vertices do not move it. Stops the importer by an error when it has
/// enough. Thread safety: none.
class OriginSurvey final : public IgnoringSink {
 public:
  /// The point, in model coordinates. Nothing: no position has come.
  std::optional<glm::dvec3> Place() const;

  Status AddPosition(const glm::dvec3& position, const Rgba8&) override;
  Status AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) override;

 private:
  static constexpr size_t kMost = 1 << 16;
  struct Face {
    uint32_t corners[3];
  };
  struct Weighed {
    glm::dvec3 place;
    double weight;
  };
  std::vector<Weighed> Triangles() const;

  std::vector<glm::dvec3> positions_;
  std::vector<Face> faces_;
};

}  // namespace quarry

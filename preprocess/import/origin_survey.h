#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <optional>
#include <string>
#include <vector>

#include "preprocess/import/ignoring_sink.h"

namespace quarry {

/// Looks at the beginning of a model, at most 65,536 vertices and as many faces, for a place in the midst of
/// it: the median of its triangles, each weighed by how small it is, since floats lose the small ones first.
/// Where no face has come yet, the median of its vertices. One vertex far away, or a few, do not move it. An
/// importer that gives it too much is stopped by an error.
class OriginSurvey final : public IgnoringSink {
 public:
  /// Nothing: it has met no place at all.
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

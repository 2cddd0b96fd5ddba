#pragma once

#include <embree3/rtcore.h>

#include <glm/vec3.hpp>
#include <optional>
#include <vector>

#include "common/voxel/store_reader.h"
#include "tests/reference/recursive_surfaces.h"

namespace quarry::test {

/// The triangles of a store, each once, in memory and in Embree. Embree finds hits in float; positions and
/// normals are computed in double from the corners. Immutable, so thread-safe.
class RecursiveModel {
 public:
  /// Decodes all blocks of `store`. Errors: the store cannot be read; they end the test.
  explicit RecursiveModel(const StoreReader& store);
  RecursiveModel(const RecursiveModel&) = delete;
  ~RecursiveModel();

  struct Triangle {
    glm::vec3 corners[3], normals[3], colors[3];
    uint32_t material;
  };
  const std::vector<Triangle>& triangles() const { return triangles_; }
  const Material& MaterialOf(size_t triangle) const { return materials_[triangles_[triangle].material]; }

  struct Found {
    size_t triangle;
    double t, u, v;
  };
  /// The nearest hit between the origin and `end`. Units: `end` in lengths of the unit vector `direction`.
  std::optional<Found> Nearest(const glm::dvec3& origin, const glm::dvec3& direction, double end) const;
  /// The surface that a ray along `direction` has met.
  Meeting At(const Found& found, const glm::dvec3& direction) const;
  /// The distance from a surface at which rays begin. Units: scene units.
  double offset() const { return offset_; }

 private:
  void Build();

  std::vector<Material> materials_;
  std::vector<Triangle> triangles_;
  double offset_ = 0;
  RTCDevice device_;
  RTCScene scene_;
};

}  // namespace quarry::test

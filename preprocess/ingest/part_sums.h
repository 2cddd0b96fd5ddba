#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/base/bytes.h"
#include "common/voxel/parts/part_sections.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Sums up the facts of parts that follow from their triangles: how many, their box, whether they close a
/// surface, and the volume in it. The order of triangles follows from the models alone, so the sums do too.
/// Memory: 56 bytes a part, twice as many while the table grows. Thread safety: none.
class PartSums {
 public:
  /// Adds a triangle; `fault`: FaultOf(triangle). The edges of triangles without area count, as their
  /// neighbours have them too.
  void Add(const TriangleRecord& triangle, TriangleFault fault);
  /// Fills in all facts of parts but their parents.
  void GiveTo(std::vector<ScenePart>& parts) const;

  void Save(ByteWriter& out) const;
  /// Bytes that end too early make `in` not ok().
  void Restore(ByteReader& in);

 private:
  struct Sum {
    /// Hashes of the edges, added in one direction and subtracted in the other: 0 for a closed surface, and
    /// for an open surface once in 2^64.
    uint64_t edges = 0;
    double volume = 0;  ///< six times the volume, seen from `origin`
    glm::vec3 lower{ScenePart::kFar}, upper{-ScenePart::kFar};
    glm::vec3 origin{0};  ///< a corner of the first triangle with an area: near, so that little is rounded
    uint32_t triangles = 0;
  };
  std::vector<Sum> sums_;
};

}  // namespace quarry

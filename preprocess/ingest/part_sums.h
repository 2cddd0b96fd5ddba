#pragma once

#include <cstdint>
#include <glm/vec3.hpp>
#include <vector>

#include "common/base/bytes.h"
#include "common/voxel/parts/part_sections.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Facts of triangles of one part.
struct PartSum {
  /// Hashes of the edges, added in one direction and subtracted in the other: 0 for a closed surface, and
  /// for an open surface once in 2^64.
  uint64_t edges = 0;
  double volume = 0;  ///< six times the volume, seen from `origin`
  glm::vec3 lower{ScenePart::kFar}, upper{-ScenePart::kFar};
  glm::vec3 origin{0};  ///< a corner of the first triangle with an area: near, so that little is rounded
  uint32_t triangles = 0;
};

/// Triangles of one part that follow each other.
struct PartRun {
  uint32_t part = 0;
  PartSum sum;
  glm::dvec3 across{0};  ///< the sum of the triangles' normals, each of twice the area's length

  /// Adds a triangle of the part; `fault`: FaultOf(triangle). The edges of triangles without area count, as
  /// their neighbours have them too.
  void Add(const TriangleRecord& triangle, TriangleFault fault);
};

/// Adds a triangle to the last run of `runs`, or to a new one if that is of another part.
inline void AddToRuns(const TriangleRecord& triangle, TriangleFault fault, std::vector<PartRun>& runs) {
  if (runs.empty() || runs.back().part != triangle.part) runs.push_back({triangle.part, {}, {}});
  runs.back().Add(triangle, fault);
}

/// Sums up the facts of parts that follow from their triangles: how many, their box, whether they close a
/// surface, and the volume in it. The runs and their order follow from the models alone, so the sums do too.
/// Memory: 56 bytes a part, twice as many while the table grows. Thread safety: none.
class PartSums {
 public:
  void Add(const PartRun& run);
  /// Fills in all facts of parts but their parents.
  void GiveTo(std::vector<ScenePart>& parts) const;

  void Save(ByteWriter& out) const;
  /// Bytes that end too early make `in` not ok().
  void Restore(ByteReader& in);

 private:
  std::vector<PartSum> sums_;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <vector>

#include "common/kdtree/build/build.h"
#include "preprocess/ingest/part_sums.h"
#include "preprocess/ingest/polygon_fan.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Triangles that follow each other in a file, checked and summed up: what can be done before TriangleSpill
/// takes them in order. Memory: 128 bytes a triangle and 112 a run of a part, kept for the next ones, and
/// PolygonFan's.
struct TriangleBatch {
  std::vector<TriangleRecord> kept;  ///< in the order of the file
  std::vector<uint32_t> sampled;     ///< indices in `kept` that the sample may take
  std::vector<uint32_t> shining;     ///< indices in `kept` of triangles that may shine
  std::vector<PartRun> parts;        ///< of all triangles, dropped ones too
  Box bounds{glm::vec3(kInfinity), glm::vec3(-kInfinity)};
  uint64_t dropped_degenerate = 0, dropped_not_finite = 0;
  PolygonFan polygon;  ///< memory for splitting

  /// Empties the batch and keeps its memory.
  void Clear() {
    kept.clear();
    sampled.clear();
    shining.clear();
    parts.clear();
    bounds = {glm::vec3(kInfinity), glm::vec3(-kInfinity)};
    dropped_degenerate = dropped_not_finite = 0;
  }
};

}  // namespace quarry

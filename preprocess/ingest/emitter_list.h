#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "common/base/bytes.h"
#include "common/scene/material.h"
#include "common/voxel/emitters/emitter.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// Keeps the strongest triangles that shine, kMostEmitters, by area times radiance; of equal ones those with
/// the lowest ids. A map of emission counts as white. Memory: 12 MiB, once a triangle shines, and 5.5 MiB
/// more in Take(). Thread safety: none.
class EmitterList {
 public:
  /// From here on triangles of the material shine, if Shines(); before its first triangle.
  void NoteMaterial(uint32_t number, const Material& material);
  bool empty() const { return strengths_.empty(); }
  /// Whether triangles of the material shine.
  bool Wants(uint32_t material) const { return strengths_.contains(material); }
  /// Adds a triangle with an area. Any triangle may come; most do not shine.
  void Add(const TriangleRecord& triangle);

  void Save(ByteWriter& out) const;
  /// Bytes that end too early make `in` not ok().
  void Restore(ByteReader& in);
  /// The strongest, by ascending id. Their radiance is not set.
  std::vector<Emitter> Take();

 private:
  struct Ranked {
    double power;
    Emitter emitter;
  };
  void KeepStrongest();

  std::map<uint32_t, double> strengths_;  ///< mean radiance by material
  std::vector<Ranked> ranked_;            ///< at most twice as many as are kept
};

}  // namespace quarry

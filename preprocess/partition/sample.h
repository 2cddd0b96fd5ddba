#pragma once

#include <cstdint>
#include <vector>

#include "common/base/bytes.h"
#include "common/kdtree/build/build.h"
#include "preprocess/spill/triangle_record.h"

namespace quarry {

/// How a sampled triangle looks.
struct SampledLook {
  uint32_t color = 0;  ///< of its first corner, packed, see ShadingVertex
  uint16_t material = 0;
};

/// A sample of triangles, each standing for weight() triangles, from which region planes are chosen. The
/// choice depends on ids alone, never on their order. Memory: kMost triangles. Thread safety: none.
class TriangleSample {
 public:
  static constexpr size_t kMost = 256 << 10;

  void Add(const TriangleRecord& record) {
    if (Takes(record.id)) Keep(record);
  }
  /// Whether Add() would take the triangle now. A triangle that is not taken now is never taken.
  bool Takes(uint32_t id) const { return (Mix(id) & (weight_ - 1)) == 0; }
  /// Triangles that a sampled triangle stands for: 1 while all are kept, then a power of two.
  uint64_t weight() const { return weight_; }
  const std::vector<KdTriangle>& triangles() const { return triangles_; }
  /// Of the same triangles. Not saved.
  const std::vector<SampledLook>& looks() const { return looks_; }
  std::vector<KdTriangle> TakeTriangles();

  void Save(ByteWriter& out) const;
  void Restore(ByteReader& in);

 private:
  /// Source: the finalizer of MurmurHash3 (Appleby 2011).
  static uint32_t Mix(uint32_t x) {
    x = (x ^ (x >> 16)) * 0x85EBCA6Bu;
    x = (x ^ (x >> 13)) * 0xC2B2AE35u;
    return x ^ (x >> 16);
  }
  void Keep(const TriangleRecord& record);

  std::vector<KdTriangle> triangles_;
  std::vector<uint32_t> hashes_;  ///< of the triangles' ids
  std::vector<SampledLook> looks_;
  uint32_t weight_ = 1;
};

}  // namespace quarry

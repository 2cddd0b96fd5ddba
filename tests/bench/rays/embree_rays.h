#pragma once

#include <memory>
#include <string>
#include <vector>

#include "common/kdtree/ray_packet.h"
#include "tests/support/rendering/resident_scene.h"

namespace quarry::bench {

/// Ways to trace with Embree.
enum class EmbreeMode { kSingle, kPacket, kStream };

/// Embree over the triangles of a scene, best quality, and one set of rays in each of its forms.
class EmbreeRays {
 public:
  /// `robust`: Embree's watertight mode. Takes minutes for large scenes.
  EmbreeRays(const test::ResidentScene& scene, bool robust);
  ~EmbreeRays();

  /// Takes over the rays named by `active`; `any`: shadow rays; `coherent`: a hint to Embree.
  void SetRays(const std::vector<RayPacket>& packets, const std::vector<uint64_t>& active, bool any,
               bool coherent);
  /// Traces all of them, once; the time in seconds, without setting rays up.
  double Trace(EmbreeMode mode);
  /// The result of the last Trace for active ray number `index`: id (any-hit: kNoTriangle or another) and t.
  Hit Result(size_t index) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry::bench

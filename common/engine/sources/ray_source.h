#pragma once

#include <cstddef>
#include <cstdint>

#include "common/engine/sample_packet.h"
#include "common/kdtree/ray_packet.h"

namespace quarry {

/// Makes the first ray of each sample, packet by packet. Not thread-safe.
class RaySource {
 public:
  virtual ~RaySource() = default;
  /// Samples that have not begun.
  virtual uint64_t left() const = 0;

  /// Lanes of a packet.
  struct Lanes {
    uint64_t in_box = 0, missing_box = 0;
  };
  /// Begins the next samples in the lanes of a packet that are `free`: their places in the result, their
  /// weights, and their rays. Requires: left() > 0; all lanes are free unless the source is EyeRays. Returns
  /// the lanes whose rays meet the scene's box, and the others that are samples.
  virtual Lanes Next(uint64_t free, SamplePacket& samples, RayPacket& rays) = 0;
  virtual size_t memory_bytes() const = 0;
};

}  // namespace quarry

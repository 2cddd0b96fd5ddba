#pragma once

#include <cstdint>
#include <memory>

namespace quarry {

/// What nodes and leaves need of a ray of a stream: one cache line.
struct alignas(64) StreamRay {
  float reciprocal[3], shift[3];  ///< it meets a plane p at p * reciprocal + shift
  float t, t_end;                 ///< where it begins; where its hit, or a voxel that is missing, ends it
  // Its frame: axes renamed, cyclically, so that the direction's largest is the last.
  float origin[3], shear_x, shear_y, scale_z;
  float best_t;
  uint32_t last_axis;

  const float* floats() const { return reciprocal; }
  float* floats() { return reciprocal; }
};

/// The rest.
struct alignas(32) StreamHit {
  static constexpr uint32_t kAlone = 1u << 31;

  uint32_t triangle;
  float b1, b2;
  uint32_t voxel, local;
  float t_stop;       ///< where it comes to the voxel at which it stops; infinite
  uint32_t stops_at;  ///< the voxel: it is missing, or few rays come to it
  uint32_t source;    ///< packet * 64 + index; kAlone in it: stops for want of company

  float* floats() { return reinterpret_cast<float*>(this); }
};

/// Where the rays of a thread's streams lie, and the lists of nodes: 96 bytes a ray, and 5 for each level of
/// the trees that it may have come to, of which few are ever touched.
class StreamMemory {
 public:
  /// The calling thread's, for streams of all kinds one after the other.
  static StreamMemory& OfThread();

  StreamMemory() = default;
  StreamMemory(const StreamMemory&) = delete;
  StreamMemory& operator=(const StreamMemory&) = delete;
  // Not inline: what kernels share is compiled for no instruction set of theirs.
  ~StreamMemory();
  /// Room for so many rays; kept for streams to come.
  void Reserve(uint32_t count);

  static constexpr uint32_t kSlack = 64;  ///< vectors may be written behind a list
  std::unique_ptr<StreamRay[]> rays;
  std::unique_ptr<StreamHit[]> hits;
  std::unique_ptr<uint32_t[]> ids;
  std::unique_ptr<uint8_t[]> masks;

 private:
  uint32_t count_ = 0;
};

}  // namespace quarry

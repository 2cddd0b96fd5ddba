#pragma once

#include <cstdint>
#include <memory>

namespace quarry {

/// The fields of a stream's ray that nodes and leaves read: one cache line.
struct alignas(64) StreamRay {
  float reciprocal[3], shift[3];  ///< the ray meets a plane p at t = p * reciprocal + shift
  float t, t_end;                 ///< start; end: the nearest hit so far, or t_stop
  // Its frame: axes renamed cyclically so that the largest of the direction is the last.
  float origin[3], shear_x, shear_y, scale_z;
  float best_t;
  uint32_t last_axis;

  const float* floats() const { return reciprocal; }
  float* floats() { return reciprocal; }
};

/// The other fields of a stream's ray.
struct alignas(32) StreamHit {
  static constexpr uint32_t kIncoherent = 1u << 31;

  uint32_t triangle;
  float b1, b2;
  uint32_t voxel, local;
  float t_stop;       ///< t at which the ray stops; infinite: nowhere
  uint32_t stops_at;  ///< the voxel at t_stop: missing, or visited by few rays
  uint32_t source;    ///< packet * 64 + index; kIncoherent: few rays come to the voxel

  float* floats() { return reinterpret_cast<float*>(this); }
};

/// The rays of a thread's streams and the lists of nodes. Memory: 96 bytes per ray, and 5 bytes per ray and
/// level of the trees; most pages of these lists are never touched. Not thread-safe.
class StreamMemory {
 public:
  /// The calling thread's memory. Its streams use it one after the other.
  static StreamMemory& OfThread();

  StreamMemory() = default;
  StreamMemory(const StreamMemory&) = delete;
  StreamMemory& operator=(const StreamMemory&) = delete;
  // Not inline: code that kernels share must not be compiled for one instruction set.
  ~StreamMemory();
  /// Makes room for `count` rays; memory never shrinks. Allocates only when `count` is the largest so far.
  void Reserve(uint32_t count);

  static constexpr uint32_t kSlack = 64;  ///< entries: vectors may be written behind a list's end
  std::unique_ptr<StreamRay[]> rays;
  std::unique_ptr<StreamHit[]> hits;
  std::unique_ptr<uint32_t[]> ids;
  std::unique_ptr<uint8_t[]> masks;

 private:
  uint32_t count_ = 0;
};

}  // namespace quarry

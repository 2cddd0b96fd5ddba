#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "common/base/status.h"
#include "common/scene/render_job.h"

namespace quarry {

/// Upper bound on the bytes that a frame takes of the master, from its beginning until its client has it:
/// pixels, its tiles' records and sums, and the encoded image twice, kept and queued. Does not overflow:
/// 65,536 squared pixels with all layers are 2^38 bytes. Requires: `view` is normalized.
uint64_t FrameBytes(const View& view, const ImageFormat& format);
/// Bytes that a job of `frames` frames takes while it is kept.
uint64_t JobBytes(size_t frames);

/// The budget of --frame-memory: an eighth for jobs, the rest for frames and their images.
/// Units: bytes. Not thread-safe, but reservations may end on any thread.
class FrameMemory {
 public:
  explicit FrameMemory(uint64_t limit) : limit_(limit), used_(std::make_shared<std::atomic<uint64_t>>(0)) {}

  uint64_t for_jobs() const { return limit_ / 8; }
  uint64_t for_frames() const { return limit_ - for_jobs(); }
  /// Errors (a sentence with figures): one frame takes more than there is for frames; the job and the kept
  /// jobs (`jobs_bytes`) take more than there is for jobs.
  Status CheckJob(const RenderJob& job, uint64_t jobs_bytes) const;

  /// Bytes taken until the last copy of the reservation ends. Taken whether there is room or not.
  using Reservation = std::shared_ptr<const uint64_t>;
  Reservation Take(uint64_t bytes);
  uint64_t used() const { return *used_; }

 private:
  uint64_t limit_;
  std::shared_ptr<std::atomic<uint64_t>> used_;
};

}  // namespace quarry

#pragma once

#include <atomic>
#include <cstdint>
#include <memory>

#include "common/base/status.h"
#include "common/scene/render_job.h"

namespace quarry {

/// Most bytes that a frame takes of the master, from its beginning until its client has it: pixels, what is
/// noted of its tiles, and the encoded image twice, kept and queued. `one`: a normalized job. No overflow:
/// 65,536 squared with all layers is 2^38 bytes.
uint64_t FrameBytes(const RenderJob& one);
/// Bytes that a job of so many frames takes while it is kept.
uint64_t JobBytes(size_t frames);
/// A bound on an encoded image: what does not compress.
uint64_t EncodedBytes(const RenderJob& one);

/// What --frame-memory gives out: an eighth of it to jobs, the rest to frames and their images. Reservations
/// may end on any thread.
class FrameMemory {
 public:
  explicit FrameMemory(uint64_t limit) : limit_(limit), used_(std::make_shared<std::atomic<uint64_t>>(0)) {}

  uint64_t for_jobs() const { return limit_ / 8; }
  uint64_t for_frames() const { return limit_ - for_jobs(); }
  /// Errors (a sentence with figures): a frame of it alone takes more than there is for frames; it and the
  /// jobs that are kept, `jobs_bytes`, more than there is for jobs.
  Status CheckJob(const RenderJob& job, uint64_t jobs_bytes) const;

  /// Bytes given to frames until the last copy of what is returned has gone. Taken whether there is room or
  /// not.
  using Reservation = std::shared_ptr<const uint64_t>;
  Reservation Take(uint64_t bytes);
  uint64_t used() const { return *used_; }

 private:
  uint64_t limit_;
  std::shared_ptr<std::atomic<uint64_t>> used_;
};

}  // namespace quarry

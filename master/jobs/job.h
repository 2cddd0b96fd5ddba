#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "master/jobs/frame_memory.h"

namespace quarry {

/// A job: the states of its frames, finished images, and the clients that wait for them. An image is kept
/// until every client has it, or for good in a spool. Units: seconds of the caller's clock. Not thread-safe,
/// but for `over`.
struct Job {
  enum class FrameState : uint8_t { kToDo, kActive, kFinished };
  struct Finished {
    Bytes image;                      ///< empty once it is on disk and sent
    std::string statistics;           ///< JSON
    FrameMemory::Reservation memory;  ///< the image's
  };
  struct Client {
    std::shared_ptr<Connection> connection;
    size_t next = 0;  ///< the frame to be sent next
  };

  std::string id;  ///< see JobId
  RenderJob job;
  std::vector<FrameState> states;
  std::vector<Finished> finished;
  std::vector<Client> clients;
  double alone_since_s = 0;  ///< when the last client went
  const std::chrono::steady_clock::time_point asked = std::chrono::steady_clock::now();
  /// The job was under way when a master ended, and has finished no frame since: it may be the cause.
  bool suspect = false;
  bool tried = false;             ///< a frame of it has been begun by this master
  bool metering = false;          ///< its exposure has been asked for
  std::optional<double> ev;       ///< of its PNGs, once it is known
  std::optional<double> metered;  ///< of its first view, if it has a noise, once it is known
  std::atomic<bool> over{false};  ///< set once; threads at work on the job look at it

  Job(std::string name, RenderJob render_job)
      : id(std::move(name)),
        job(std::move(render_job)),
        states(job.cameras.size(), FrameState::kToDo),
        finished(job.cameras.size()) {}
  bool Complete() const;
  /// The first frame to do, or states.size().
  size_t NextToDo() const;
  /// The number that clients know frame `index` by.
  uint32_t Number(size_t index) const { return job.first_frame + static_cast<uint32_t>(index); }
};

}  // namespace quarry

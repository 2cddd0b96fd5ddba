#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "master/jobs/frame_memory.h"
#include "master/jobs/job.h"
#include "master/jobs/spool.h"
#include "master/pictures/image_output.h"

namespace boost::asio {
class io_context;
class thread_pool;
}  // namespace boost::asio

namespace quarry {

/// A frame of a job.
struct JobFrame {
  std::shared_ptr<Job> job;
  size_t index = 0;  ///< of the job's frames
  View view;
  FrameMemory::Reservation memory;  ///< while it is under way
  uint32_t number() const { return job->Number(index); }
};

/// Clients' jobs, from the request to the last frame that is sent. Images are encoded, and written to the
/// spool if there is one, on a thread of this class.
/// Units: seconds of the caller's clock; bytes. Not thread-safe: used on the io_context's thread.
class Jobs {
 public:
  struct Callbacks {
    std::function<void()> on_work;            ///< a frame may be begun
    std::function<void(const Job&)> on_over;  ///< the job is over: done, failed or abandoned
    std::function<void(const std::string&)> log;
    /// Begins to meter the exposure (EV) of a job's first view. `done` is called with it, later, unless the
    /// job is over.
    std::function<void(const Job&, std::function<void(double)> done)> meter;
    /// Sets the selection of a view's parts. Empty: views have none.
    std::function<Status(View&)> complete = {};
  };
  /// `frame_memory`: bytes of frames and jobs, see FrameMemory.
  Jobs(boost::asio::io_context& io, const SceneFacts& scene, std::optional<Spool> spool,
       uint64_t frame_memory, Callbacks callbacks);
  ~Jobs();

  /// Continues the spool's jobs, except jobs that have ended Spool::kMostTries masters, or that need more
  /// memory than there is.
  void TakeUp();
  /// A client asks for a job, and may have some of its frames. A job asked for twice is one job.
  /// Errors: the job takes more memory than there is, or was set aside; a part that it names is not there.
  /// Nothing of it is kept then.
  Status Ask(const std::shared_ptr<Connection>& client, JobRequest request);
  /// Returns whether the client still waited for frames.
  bool ForgetClient(const std::shared_ptr<Connection>& client, double now_s);
  /// Counts bytes of an image that a client has been given and that this process still holds.
  FrameMemory::Reservation Hold(uint64_t bytes) { return memory_.Take(bytes); }
  const std::deque<std::shared_ptr<Job>>& all() const { return jobs_; }

  /// Begins the next frame. None: no frame is to do, too many are on their way to the disk, or a frame under
  /// way has its memory. A suspect job's frame is under way alone.
  std::optional<JobFrame> Begin();
  /// The frames that begin next, `most` at most, in their order.
  std::vector<JobFrame> Upcoming(size_t most) const;
  /// Takes a frame's pixels, to be encoded and delivered.
  void Finish(JobFrame frame, std::vector<uint32_t> pixels, std::string statistics);
  /// The job of this id, if pixels or frames of it wait for its exposure; else null.
  std::shared_ptr<Job> AwaitsExposure(const std::string& id) const;
  /// Ends a job that cannot be done, and informs its clients.
  void Fail(std::shared_ptr<Job> job, const std::string& sentence);

  /// Begins no frame more, sends none, and calls `done` when the frames that are rendered are in the spool,
  /// once their exposures are known:
  /// the end of this master is then not counted against its jobs (Spool::kMostTries). Requires: there is a
  /// spool.
  void Rest(std::function<void()> done);
  /// Sends finished frames to clients that have room for more.
  void Deliver();
  /// Ends jobs whose clients have been gone for kClientGraceS, unless a spool keeps them.
  void DropAbandoned(double now_s);

 private:
  /// A frame whose pixels are there.
  struct Rendered {
    JobFrame frame;
    std::vector<uint32_t> pixels;
    std::string statistics;
  };

  void Encode(Rendered rendered, double ev);
  void EndRest();
  void Remove(std::shared_ptr<Job> job);
  Status Complete(RenderJob& job) const;
  bool HasRoom(const Job& job);
  bool DropLastImage();
  void Meter(const std::shared_ptr<Job>& job);
  void Metered(const std::shared_ptr<Job>& job, double metered);
  void EncodeWaiting(const std::shared_ptr<Job>& job);
  uint64_t JobsBytes() const;
  uint64_t QueuedBytes() const;
  bool MaySend(uint64_t image_bytes) const;
  template <class Write>
  void WriteToSpool(const Job& job, Write write) const;
  void OnImage(const std::shared_ptr<Job>& job, size_t index, Result<Bytes> image, std::string statistics);
  void Deliver(const std::shared_ptr<Job>& job);
  bool SendFrame(Job& job, const Job::Client& client);

  boost::asio::io_context& io_;
  const SceneFacts scene_;
  const std::optional<Spool> spool_;
  FrameMemory memory_;
  const Callbacks callbacks_;
  std::deque<std::shared_ptr<Job>> jobs_;
  bool rests_ = false;                     ///< Rest() was called
  std::function<void()> rested_;           ///< its `done`, until it is on its way
  int encoding_ = 0;                       ///< frames on their way from the last tile to Job::finished
  std::vector<Rendered> waiting_;          ///< of these: they wait for their jobs' exposures
  std::weak_ptr<const uint64_t> suspect_;  ///< the frame of a suspect job that is under way
  std::stop_source stop_;                  ///< of writing, when this ends
  std::unique_ptr<boost::asio::thread_pool> encoder_;  ///< last: its thread uses the members above
};

}  // namespace quarry

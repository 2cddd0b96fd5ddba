#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "master/jobs/frame_memory.h"
#include "master/jobs/job.h"
#include "master/jobs/spool.h"

namespace boost::asio {
class io_context;
class thread_pool;
}  // namespace boost::asio

namespace quarry {

/// A frame of a job.
struct JobFrame {
  std::shared_ptr<Job> job;
  size_t index = 0;                 ///< of the job's frames
  RenderJob frame_job;              ///< the job with this frame only
  FrameMemory::Reservation memory;  ///< while it is under way
};

/// What clients have asked for, from the request to the last frame that is sent. Images are encoded, and
/// written to the spool if there is one, on a thread of its own; the rest is used from the io_context's
/// thread. Time comes in.
class Jobs {
 public:
  struct Callbacks {
    std::function<void()> on_work;            ///< a frame may be begun
    std::function<void(const Job&)> on_over;  ///< nobody wants the job any more
    std::function<void(const std::string&)> log;
  };
  /// `frame_memory`: bytes of frames and jobs, see FrameMemory.
  Jobs(boost::asio::io_context& io, const SceneId& scene, std::optional<Spool> spool, uint64_t frame_memory,
       Callbacks callbacks);
  ~Jobs();

  /// Goes on with those in the spool; not with one that has ended several masters, nor with one for which
  /// there is too little memory.
  void TakeUp();
  /// A client wants a job, of which it may have some frames. The same one asked for again is the same.
  /// Errors: it takes more memory than there is; it was set aside. Nothing of it is kept then.
  Status Ask(const std::shared_ptr<Connection>& client, JobRequest request);
  /// Whether it still had frames to come.
  bool ForgetClient(const std::shared_ptr<Connection>& client, double now_s);
  const std::deque<std::shared_ptr<Job>>& all() const { return jobs_; }

  /// The next frame to do, which is under way from now on. None: nothing is to do, too many are on their way
  /// to the disk, or there is no memory for it until another is done. A suspect job is under way alone.
  std::optional<JobFrame> Begin();
  /// Those that are to be begun next, in their order.
  std::vector<JobFrame> Upcoming(size_t most) const;
  /// A frame's pixels are all there.
  void Finish(JobFrame frame, std::vector<uint32_t> pixels, std::string statistics);
  /// It cannot be done: its clients are told.
  void Fail(std::shared_ptr<Job> job, const std::string& sentence);

  /// Sends finished frames to clients that have room for more.
  void Deliver();
  /// Ends jobs whose client has gone for good, unless they are kept on disk.
  void DropAbandoned(double now_s);

 private:
  void Remove(std::shared_ptr<Job> job);
  bool HasRoom(const Job& job, size_t index);
  bool DropLastImage();
  uint64_t JobsBytes() const;
  uint64_t QueuedBytes() const;
  bool MaySend(uint64_t image_bytes) const;
  template <class Write>
  void WriteToSpool(const Job& job, Write write) const;
  void OnImage(const std::shared_ptr<Job>& job, size_t index, Result<Bytes> image, std::string statistics);
  void Deliver(const std::shared_ptr<Job>& job);
  bool SendFrame(Job& job, const Job::Client& client);

  boost::asio::io_context& io_;
  const SceneId scene_;
  const std::optional<Spool> spool_;
  FrameMemory memory_;
  const Callbacks callbacks_;
  std::deque<std::shared_ptr<Job>> jobs_;
  int encoding_ = 0;                       ///< frames on their way from the last tile to Job::finished
  std::weak_ptr<const uint64_t> suspect_;  ///< the frame of a suspect job that is under way
  std::unique_ptr<boost::asio::thread_pool> encoder_;  ///< last: what it runs uses all of the above
};

}  // namespace quarry

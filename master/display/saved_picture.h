#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "common/http/http_server.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "master/jobs/frame_memory.h"

namespace boost::asio {
class io_context;
}  // namespace boost::asio

namespace quarry {

/// A picture that a viewer saves: a job of one frame, and its PNG until the browser has it.
class SavedPicture;

/// The pictures that viewers save, of any size. They are rendered, and counted in memory, like jobs. Runs on
/// the io_context's thread.
class SavedPictures {
 public:
  /// The functions of the master's jobs, on the io_context's thread.
  struct JobService {
    /// As Jobs::Ask() and Jobs::ForgetClient().
    std::function<Status(const std::shared_ptr<Connection>&, JobRequest)> ask;
    std::function<void(const std::shared_ptr<Connection>&)> forget;
    /// As FrameMemory::Take().
    std::function<FrameMemory::Reservation(uint64_t)> hold;
  };
  /// The progress of a picture.
  struct News {
    double done = 0;      ///< in [0, 1]
    std::string file;     ///< that Fetch() gives, once it is done
    uint64_t bytes = 0;   ///< of the file
    std::string failure;  ///< a sentence, when it cannot be had
  };
  using OnNews = std::function<void(const News&)>;

  /// `io` must outlive this. `now`: seconds of a steady clock.
  SavedPictures(boost::asio::io_context& io, JobService jobs, std::function<double()> now);
  ~SavedPictures();

  /// Asks for a picture. `tell` is called from later events, until the news is a file or a failure. The job
  /// ends with the last copy of the result. Errors: the job is refused.
  Result<std::shared_ptr<SavedPicture>> Ask(RenderJob job, OnNews on_news);
  /// The file of this name, for a browser that has the session; 404 when it is not there, or no longer.
  HttpResponse Fetch(const std::string& name) const;
  /// Whether a name is of the form that News::file has.
  static bool Names(const std::string& name);
  /// Forgets files that have been there for kKeepS.
  void Tick();

 private:
  friend class SavedPicture;
  /// Seconds that a file is kept: a browser fetches it at once.
  static constexpr double kKeepS = 60;
  struct File {
    std::shared_ptr<const Bytes> bytes;
    double since_s = 0;
  };
  std::string Keep(Bytes image);

  boost::asio::io_context& io_;
  const JobService jobs_;
  const std::function<double()> now_;
  std::map<std::string, File> files_;
};

}  // namespace quarry

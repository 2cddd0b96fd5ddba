#pragma once

#include <functional>
#include <memory>
#include <optional>

#include "master/display/frame_encoder.h"

namespace boost::asio {
class io_context;
class thread_pool;
}  // namespace boost::asio

namespace quarry {

/// A thread that encodes frames, one after the other in the order of the calls.
class EncodingThread {
 public:
  struct Work {
    std::shared_ptr<const DueFrame> frame;
    SceneFacts scene;
    int quality = 80;                                ///< of JPEG, in [1, 100]
    std::shared_ptr<std::optional<ToneTable>> tone;  ///< of the viewer's last frame; has one frame under way
  };

  /// `io` must outlive this.
  explicit EncodingThread(boost::asio::io_context& io);
  ~EncodingThread();
  EncodingThread(const EncodingThread&) = delete;
  EncodingThread& operator=(const EncodingThread&) = delete;

  /// Encodes a frame, then calls `then` on the io_context's thread. Call on that thread.
  /// Requires: no other pending work uses `work.tone`; Join() was not called.
  void Encode(Work work, std::function<void(const Result<EncodedFrame>&)> then);
  /// Waits for the pending work. Afterwards no work may be given.
  void Join();

 private:
  boost::asio::io_context& io_;
  FrameEncoder encoder_;  ///< used only on the thread
  std::unique_ptr<boost::asio::thread_pool> thread_;
};

}  // namespace quarry

#pragma once

#include <functional>
#include <memory>

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Calls a function later, on the io_context's thread. Used from that thread. Destroying it cancels the call.
class Timer {
 public:
  explicit Timer(boost::asio::io_context& io);
  ~Timer();
  /// Calls `then` once after `seconds`. A call that is still pending is cancelled.
  void Set(double seconds, std::function<void()> then);
  /// Cancels a pending call.
  void Stop();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry

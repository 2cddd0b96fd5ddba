#pragma once

#include <functional>
#include <memory>

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Calls a function later, on an io_context's thread. Used from that thread.
class Timer {
 public:
  explicit Timer(boost::asio::io_context& io);
  ~Timer();
  /// Calls `then` once after `seconds`, in the place of the function that was to be called before.
  void Set(double seconds, std::function<void()> then);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry

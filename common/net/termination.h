#pragma once

#include <functional>
#include <memory>

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Takes the first SIGTERM as a request to end well (AwaitTermination). Used from the io_context's thread.
class Termination {
 public:
  virtual ~Termination() = default;
  /// `on_request` is called at most once, on the io_context's thread, unless this is destroyed before.
  static std::unique_ptr<Termination> Take(boost::asio::io_context& io, std::function<void()> on_request);
};

}  // namespace quarry

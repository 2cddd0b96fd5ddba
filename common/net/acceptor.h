#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/net/connection.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Listens at an address and accepts connections until it is destroyed, which may happen within a handler.
/// When the process can open no more files, it pauses instead of spending a core on failing accepts.
/// Thread safety: none; handlers run on the io_context's thread.
class Acceptor {
 public:
  struct Handlers {
    /// Takes a connected socket. Returns the pause before the next connection is accepted.
    std::function<std::chrono::milliseconds(int socket)> on_socket;
    /// An accept has failed, by too many open files for instance: frees a descriptor.
    std::function<void(const std::string& reason)> on_failure;
  };
  /// `encrypted`: connections are. Without encryption only loopback addresses are allowed, and `advice` ends
  /// the sentence that refuses others. Errors: the address is unknown, in use or forbidden. Errors (usage):
  /// it is not a loopback address.
  static Result<std::unique_ptr<Acceptor>> Open(boost::asio::io_context& io, const Endpoint& endpoint,
                                                bool encrypted, std::string_view advice);
  virtual ~Acceptor() = default;

  /// Begins to accept.
  virtual void Start(Handlers handlers) = 0;
  virtual uint16_t port() const = 0;
};

}  // namespace quarry

#pragma once

#include <chrono>
#include <memory>
#include <string>

#include "common/net/connection.h"
#include "common/net/incoming_budget.h"

// Connections over an open socket; internal to common/net. Other code knows Connection and not Asio.

namespace quarry {

/// The view that a listener has of a connection it accepted. Used from the io_context's thread.
class AcceptedConnection : public Connection {
 public:
  using Clock = std::chrono::steady_clock;

  /// Open, and its first message has not come yet.
  virtual bool newcomer() const = 0;
  /// Closed by either side; its descriptor is free.
  virtual bool closed() const = 0;
  /// The peer has greeted as a fetcher of blocks. Dropping it is cheap: it connects again at its next
  /// request.
  virtual bool fetches() const = 0;
  /// The time of the last byte received.
  virtual Clock::time_point heard() const = 0;
  /// Drops the connection when a message stays half-read, the peer stays silent, or it takes no queued bytes
  /// for too long. Listener states the limits. Requires: a call about every second.
  virtual void Watch(Clock::time_point now) = 0;
  /// Closes at once and calls on_close. `permanent`: trying again cannot help.
  virtual void Drop(std::string message, bool permanent) = 0;
};

/// Makes a connection, with TLS if `security` has it. Takes ownership of `socket`, a connected TCP socket.
/// `host` is the name that a client connects to; an accepting side passes an empty `host` and the budget of
/// its listener.
std::shared_ptr<AcceptedConnection> MakeConnection(boost::asio::io_context& io, int socket,
                                                   const Security& security, const std::string& host,
                                                   std::shared_ptr<IncomingBudget> budget);

}  // namespace quarry

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace quarry::test {

/// An HTTP server whose answers a test makes up byte by byte, on a free loopback port, with a thread a
/// connection.
class FaultServer {
 public:
  enum class Then {
    kKeep,   ///< wait for the next request
    kClose,  ///< close the connection
    kStall,  ///< send nothing more, leave it open
  };
  struct Answer {
    std::string bytes;
    Then then = Then::kKeep;
  };
  struct Request {
    std::string head;       ///< up to the empty line
    uint64_t first = 0;     ///< of the range asked for
    uint64_t last = 0;      ///< of the range asked for
    int number = 0;         ///< over all connections, from 0
    int on_connection = 0;  ///< of this connection, from 0
    int connection = 0;     ///< from 0
  };
  using Handler = std::function<Answer(const Request&)>;

  /// `handler` is called by one thread at a time.
  explicit FaultServer(Handler handler);
  ~FaultServer();

  uint16_t port() const;
  /// "http://127.0.0.1:PORT/store"
  std::string url() const;

  /// The right answer to `request` from `file`.
  static std::string Part(const Request& request, const std::string& file);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry::test

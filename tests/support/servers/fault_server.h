#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace quarry::test {

/// An HTTP server on a free loopback port whose answers a test gives byte by byte. It has a thread per
/// connection.
class FaultServer {
 public:
  enum class Then {
    kKeep,     ///< wait for the next request
    kClose,    ///< close the connection
    kStall,    ///< send nothing more and keep the connection open
    kTrickle,  ///< send it in pieces of 8 KiB, 50 ms apart, and close the connection
  };
  struct Answer {
    std::string bytes;
    Then then = Then::kKeep;
  };
  struct Request {
    std::string head;       ///< up to the empty line
    uint64_t first = 0;     ///< first byte of the range
    uint64_t last = 0;      ///< last byte of the range
    int number = 0;         ///< number of the request over all connections, from 0
    int on_connection = 0;  ///< number of the request on its connection, from 0
    int connection = 0;     ///< number of the connection, from 0
  };
  using Handler = std::function<Answer(const Request&)>;

  /// Starts the server. `handler` is called by one thread at a time.
  explicit FaultServer(Handler handler);
  ~FaultServer();

  uint16_t port() const;
  /// "http://127.0.0.1:PORT/store"
  std::string url() const;

  /// The correct answer to `request` from the bytes of `file`.
  static std::string Part(const Request& request, const std::string& file);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry::test

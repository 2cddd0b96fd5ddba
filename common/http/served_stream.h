#pragma once

#include <boost/asio/buffer.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/system/error_code.hpp>
#include <chrono>
#include <cstddef>
#include <memory>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

struct ssl_ctx_st;

namespace boost::beast {
enum class role_type;
}

// The stream under Beast's HTTP and WebSockets; internal to common/http.

namespace quarry {

/// The bytes of an accepted connection, plain or over TLS, as one type: so Beast's templates are compiled
/// once instead of twice. An AsyncStream as Asio defines it. A time limit holds for reading and writing
/// together, and ends them with beast::error::timeout. Used from the io_context's thread.
class ServedStream {
 public:
  using ErrorCode = boost::system::error_code;
  using executor_type = boost::asio::io_context::executor_type;
  /// A handler, called when its operation ends. It is destroyed without a call if the io_context ends first.
  class Then {
   public:
    virtual ~Then() = default;
    virtual void Call(const ErrorCode& error, size_t bytes) = 0;
  };
  /// A stream of one kind: plain, or over TLS.
  class Transport {
   public:
    virtual ~Transport() = default;
    virtual void Handshake(std::unique_ptr<Then> then) = 0;
    virtual void ReadSome(const std::vector<boost::asio::mutable_buffer>& room,
                          std::unique_ptr<Then> then) = 0;
    virtual void WriteSome(const std::vector<boost::asio::const_buffer>& pieces,
                           std::unique_ptr<Then> then) = 0;
    /// Ends the stream in order: TLS sends its close notice, a plain stream sends nothing.
    virtual void TakeLeave(std::unique_ptr<Then> then) = 0;
    virtual void TearDown(std::unique_ptr<Then> then) = 0;
    virtual void ReadBelow(const boost::asio::mutable_buffer& room, std::unique_ptr<Then> then) = 0;
    virtual void StopSending() = 0;
    virtual void Close() = 0;
    virtual void ExpiresAfter(std::chrono::steady_clock::duration time) = 0;
    virtual void ExpiresNever() = 0;
    virtual std::string PeerAddress(bool& loopback) = 0;
  };

  /// Takes over `socket`, a connected TCP socket. Without `tls` the stream is plain.
  ServedStream(boost::asio::io_context& io, int socket, ssl_ctx_st* tls);

  executor_type get_executor() const { return executor_; }
  template <class Room, class Handler>
  void async_read_some(const Room& room, Handler&& handler) {
    transport_->ReadSome(List<boost::asio::mutable_buffer>(room), Erased(std::forward<Handler>(handler)));
  }
  template <class Pieces, class Handler>
  void async_write_some(const Pieces& pieces, Handler&& handler) {
    transport_->WriteSome(List<boost::asio::const_buffer>(pieces), Erased(std::forward<Handler>(handler)));
  }
  /// The TLS handshake of a server; at once without TLS.
  template <class Handler>
  void Handshake(Handler&& handler) {
    transport_->Handshake(Erased(std::forward<Handler>(handler)));
  }
  template <class Handler>
  void TakeLeave(Handler&& handler) {
    transport_->TakeLeave(Erased(std::forward<Handler>(handler)));
  }
  /// Ends the connection as a WebSocket's end asks.
  template <class Handler>
  void TearDown(Handler&& handler) {
    transport_->TearDown(Erased(std::forward<Handler>(handler)));
  }
  /// Reads from the socket itself, below TLS.
  template <class Handler>
  void ReadBelow(const boost::asio::mutable_buffer& room, Handler&& handler) {
    transport_->ReadBelow(room, Erased(std::forward<Handler>(handler)));
  }
  void StopSending() { transport_->StopSending(); }
  void Close() { transport_->Close(); }
  void ExpiresAfter(std::chrono::steady_clock::duration time) { transport_->ExpiresAfter(time); }
  void ExpiresNever() { transport_->ExpiresNever(); }
  /// The peer's address and port for logs, and whether it is this machine. "?": the peer has already
  /// disconnected.
  std::string PeerAddress(bool& loopback) { return transport_->PeerAddress(loopback); }

 private:
  template <class Handler>
  class Calling final : public Then {
   public:
    explicit Calling(Handler handler) : handler_(std::move(handler)) {}
    void Call(const ErrorCode& error, size_t bytes) override {
      // Moved out: the handler may begin the next operation, or release the stream.
      Handler handler(std::move(handler_));
      handler(error, bytes);
    }

   private:
    Handler handler_;
  };
  template <class Handler>
  static std::unique_ptr<Then> Erased(Handler&& handler) {
    return std::make_unique<Calling<std::decay_t<Handler>>>(std::forward<Handler>(handler));
  }
  /// As many buffers as one call of the system takes; the next call sends the rest.
  template <class Buffer, class Sequence>
  static std::vector<Buffer> List(const Sequence& sequence) {
    constexpr size_t kMostBuffers = 64;
    std::vector<Buffer> list;
    const auto end = boost::asio::buffer_sequence_end(sequence);
    for (auto at = boost::asio::buffer_sequence_begin(sequence); at != end && list.size() < kMostBuffers;
         ++at)
      list.emplace_back(*at);
    return list;
  }

  executor_type executor_;
  std::unique_ptr<Transport> transport_;
};

// How Beast's WebSockets end a stream.
template <class Handler>
void async_teardown(boost::beast::role_type, ServedStream& stream, Handler&& handler) {
  stream.TearDown([handler = std::decay_t<Handler>(std::forward<Handler>(handler))](
                      const ServedStream::ErrorCode& error, size_t) mutable { handler(error); });
}
inline void beast_close_socket(ServedStream& stream) { stream.Close(); }

}  // namespace quarry

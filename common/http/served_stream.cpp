#include "common/http/served_stream.h"

#include <fmt/format.h>
#include <openssl/ssl.h>
#include <sys/socket.h>

#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <boost/beast/websocket/teardown.hpp>

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;
using TlsStream = beast::ssl_stream<beast::tcp_stream>;
using ThenPtr = std::unique_ptr<ServedStream::Then>;

/// The handler of every operation.
struct Continue {
  ThenPtr then;
  void operator()(const ErrorCode& error, size_t bytes = 0) { then->Call(error, bytes); }
};

TlsStream Encrypted(tcp::socket socket, ssl_ctx_st* tls) {
  SSL_CTX_up_ref(tls);
  asio::ssl::context context(tls);
  return TlsStream(std::move(socket), context);
}

bool IsLoopback(const asio::ip::address& address) {
  if (address.is_v6() && address.to_v6().is_v4_mapped())
    return asio::ip::make_address_v4(asio::ip::v4_mapped, address.to_v6()).is_loopback();
  return address.is_loopback();
}

/// Stream is beast::tcp_stream or TlsStream.
template <class Stream>
class StreamTransport final : public ServedStream::Transport {
  static constexpr bool kTls = std::is_same_v<Stream, TlsStream>;

 public:
  explicit StreamTransport(Stream stream) : stream_(std::move(stream)) {
    ErrorCode ignored;
    socket().set_option(tcp::no_delay(true), ignored);
  }

  void Handshake(ThenPtr then) override {
    if constexpr (kTls)
      stream_.async_handshake(asio::ssl::stream_base::server, Continue{std::move(then)});
    else
      AtOnce(std::move(then));
  }
  void ReadSome(const std::vector<asio::mutable_buffer>& room, ThenPtr then) override {
    stream_.async_read_some(room, Continue{std::move(then)});
  }
  void WriteSome(const std::vector<asio::const_buffer>& pieces, ThenPtr then) override {
    stream_.async_write_some(pieces, Continue{std::move(then)});
  }
  void TakeLeave(ThenPtr then) override {
    if constexpr (kTls)
      stream_.async_shutdown(Continue{std::move(then)});
    else
      AtOnce(std::move(then));
  }
  void TearDown(ThenPtr then) override {
    using beast::websocket::async_teardown;
    async_teardown(beast::role_type::server, stream_, Continue{std::move(then)});
  }
  void ReadBelow(const asio::mutable_buffer& room, ThenPtr then) override {
    below().async_read_some(std::vector<asio::mutable_buffer>{room}, Continue{std::move(then)});
  }
  void StopSending() override {
    ErrorCode ignored;
    socket().shutdown(tcp::socket::shutdown_send, ignored);
  }
  void Close() override { below().close(); }
  void ExpiresAfter(std::chrono::steady_clock::duration time) override { below().expires_after(time); }
  void ExpiresNever() override { below().expires_never(); }
  std::string PeerAddress(bool& loopback) override {
    ErrorCode error;
    const auto remote = socket().remote_endpoint(error);
    if (error) return "?";
    loopback = IsLoopback(remote.address());
    return fmt::format(fmt::runtime(remote.address().is_v6() ? "[{}]:{}" : "{}:{}"),
                       remote.address().to_string(), remote.port());
  }

 private:
  beast::tcp_stream& below() { return beast::get_lowest_layer(stream_); }
  tcp::socket& socket() { return below().socket(); }
  void AtOnce(ThenPtr then) {
    asio::post(stream_.get_executor(), [then = std::move(then)] { then->Call({}, 0); });
  }

  Stream stream_;
};

std::unique_ptr<ServedStream::Transport> MakeTransport(asio::io_context& io, int socket, ssl_ctx_st* tls) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  const bool v6 = ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
                  address.ss_family == AF_INET6;
  tcp::socket plain(io, v6 ? tcp::v6() : tcp::v4(), socket);
  if (tls) return std::make_unique<StreamTransport<TlsStream>>(Encrypted(std::move(plain), tls));
  return std::make_unique<StreamTransport<beast::tcp_stream>>(beast::tcp_stream(std::move(plain)));
}

}  // namespace

ServedStream::ServedStream(asio::io_context& io, int socket, ssl_ctx_st* tls)
    : executor_(io.get_executor()), transport_(MakeTransport(io, socket, tls)) {}

}  // namespace quarry

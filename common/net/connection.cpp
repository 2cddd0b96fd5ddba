#include "common/net/connection.h"

#include <fmt/format.h>

#include <array>
#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/write.hpp>
#include <charconv>
#include <deque>
#include <utility>

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

constexpr auto kHandshakeTime = std::chrono::seconds(10);

std::string EndpointText(const tcp::endpoint& e) {
  const std::string host = e.address().to_string();
  return e.address().is_v6() ? fmt::format("[{}]:{}", host, e.port()) : fmt::format("{}:{}", host, e.port());
}

class TcpConnection final : public Connection {
 public:
  explicit TcpConnection(tcp::socket socket)
      : socket_(std::move(socket)), handshake_(socket_.get_executor()) {
    ErrorCode ignored;
    socket_.set_option(tcp::no_delay(true), ignored);
    const auto remote = socket_.remote_endpoint(ignored);
    peer_ = ignored ? "?" : EndpointText(remote);
  }

  void Start(OnMessage on_message, OnClose on_close) override {
    on_message_ = std::move(on_message);
    on_close_ = std::move(on_close);
    asio::post(socket_.get_executor(), [self = Self()] {
      self->outgoing_.push_front(EncodePreamble());
      if (!self->writing_) self->WriteNext();
      self->ReadPreamble();
    });
  }

  void Send(Message message) override {
    const uint64_t bytes = kFrameHeaderBytes + message.table.size() + message.raw.size();
    queued_ += bytes;
    asio::post(socket_.get_executor(), [self = Self(), bytes, message = std::move(message)]() mutable {
      if (self->closed_ || self->closing_) {
        self->queued_ -= bytes;
        return;
      }
      Bytes head = EncodeFrameHeader(message);
      head.insert(head.end(), message.table.begin(), message.table.end());
      self->outgoing_.push_back(std::move(head));
      if (!message.raw.empty()) self->outgoing_.push_back(std::move(message.raw));
      if (!self->writing_) self->WriteNext();
    });
  }

  void Close() override {
    asio::post(socket_.get_executor(), [self = Self()] {
      self->closing_ = true;
      self->on_message_ = nullptr;
      self->on_close_ = nullptr;
      if (!self->writing_ && self->outgoing_.empty()) self->Shut();
    });
  }

  uint64_t queued_bytes() const override { return queued_; }
  uint64_t received_bytes() const override { return received_; }
  const std::string& peer() const override { return peer_; }
  std::string local_host() const override {
    ErrorCode ignored;
    return socket_.local_endpoint(ignored).address().to_string();
  }

 private:
  std::shared_ptr<TcpConnection> Self() {
    return std::static_pointer_cast<TcpConnection>(shared_from_this());
  }

  void Shut() {
    closed_ = true;
    handshake_.cancel();
    ErrorCode ignored;
    socket_.shutdown(tcp::socket::shutdown_both, ignored);
    socket_.close(ignored);
  }

  void Drop(std::string message, bool permanent = false) {
    if (closed_) return;
    handshake_.cancel();
    Shut();
    outgoing_.clear();
    // Moved out first: the handler may let go of this connection.
    OnClose handler = std::move(on_close_);
    on_close_ = nullptr;
    on_message_ = nullptr;
    if (handler) handler(Error{std::move(message), 1, permanent});
  }

  void DropOn(const ErrorCode& error) {
    Drop(error == asio::error::eof || error == asio::error::connection_reset
             ? fmt::format("{} closed the connection", peer_)
             : fmt::format("connection to {}: {}", peer_, error.message()));
  }

  void ReadPreamble() {
    handshake_.expires_after(kHandshakeTime);
    handshake_.async_wait([self = Self()](const ErrorCode& error) {
      if (!error) self->Drop(fmt::format("{} does not answer", self->peer_));
    });
    asio::async_read(socket_, asio::buffer(preamble_), [self = Self()](const ErrorCode& error, size_t) {
      if (error) return self->DropOn(error);
      self->handshake_.cancel();
      if (const Status status = CheckPreamble(self->preamble_); !status)
        return self->Drop(fmt::format("{}: {}", self->peer_, status.error().message), true);
      self->ReadHeader();
    });
  }

  void ReadHeader() {
    asio::async_read(socket_, asio::buffer(header_), [self = Self()](const ErrorCode& error, size_t n) {
      if (error) return self->DropOn(error);
      self->received_ += n;
      const auto header = DecodeFrameHeader(self->header_);
      if (!header) return self->Drop(fmt::format("{}: {}", self->peer_, header.error().message));
      self->incoming_ = {header->type, header->request, Bytes(header->table_bytes), {}};
      self->raw_bytes_ = header->raw_bytes;
      self->raw_have_ = 0;
      self->ReadTable();
    });
  }

  void ReadTable() {
    asio::async_read(socket_, asio::buffer(incoming_.table),
                     [self = Self()](const ErrorCode& error, size_t n) {
                       if (error) return self->DropOn(error);
                       self->received_ += n;
                       self->ReadRaw();
                     });
  }

  /// A large payload is allocated as it arrives, so that a claimed size alone costs nothing.
  void ReadRaw() {
    constexpr size_t kStep = 16 << 20;
    if (raw_have_ == raw_bytes_) return Deliver();
    if (raw_have_ == incoming_.raw.size())
      incoming_.raw.resize(std::min<size_t>(raw_bytes_, incoming_.raw.size() + kStep));
    socket_.async_read_some(asio::buffer(incoming_.raw.data() + raw_have_, incoming_.raw.size() - raw_have_),
                            [self = Self()](const ErrorCode& error, size_t n) {
                              if (error) return self->DropOn(error);
                              self->received_ += n;
                              self->raw_have_ += n;
                              self->ReadRaw();
                            });
  }

  void Deliver() {
    if (on_message_) on_message_(std::exchange(incoming_, {}));
    if (!closed_ && !closing_) ReadHeader();
  }

  void WriteNext() {
    if (closed_ || outgoing_.empty()) return;
    writing_ = true;
    asio::async_write(socket_, asio::buffer(outgoing_.front()),
                      [self = Self()](const ErrorCode& error, size_t n) {
                        self->writing_ = false;
                        if (error) return self->DropOn(error);
                        self->queued_ -= std::min<uint64_t>(self->queued_, n);
                        self->outgoing_.pop_front();
                        if (self->outgoing_.empty() && self->closing_) return self->Shut();
                        self->WriteNext();
                      });
  }

  tcp::socket socket_;
  asio::steady_timer handshake_;
  std::string peer_;
  OnMessage on_message_;
  OnClose on_close_;
  std::array<std::byte, kPreambleBytes> preamble_{};
  std::array<std::byte, kFrameHeaderBytes> header_{};
  Message incoming_;
  size_t raw_bytes_ = 0, raw_have_ = 0;
  uint64_t received_ = 0;
  std::deque<Bytes> outgoing_;
  std::atomic<uint64_t> queued_{0};
  bool writing_ = false, closing_ = false, closed_ = false;
};

class TcpListener final : public Listener {
 public:
  TcpListener(tcp::acceptor acceptor, OnConnection on_connection)
      : acceptor_(std::move(acceptor)), on_connection_(std::move(on_connection)) {
    Accept();
  }
  uint16_t port() const override { return acceptor_.local_endpoint().port(); }

 private:
  void Accept() {
    acceptor_.async_accept([this](const ErrorCode& error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (!error) on_connection_(std::make_shared<TcpConnection>(std::move(socket)));
      Accept();
    });
  }
  tcp::acceptor acceptor_;
  OnConnection on_connection_;
};

/// One attempt to connect, with its time limit.
struct Attempt {
  explicit Attempt(asio::io_context& io) : resolver(io), socket(io), timer(io) {}
  tcp::resolver resolver;
  tcp::socket socket;
  asio::steady_timer timer;
  bool timed_out = false;
};

}  // namespace

Result<Endpoint> ParseEndpoint(const std::string& text, const std::string& what) {
  const size_t colon = text.rfind(':');
  Endpoint endpoint;
  if (colon != std::string::npos && colon > 0) {
    const char* end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, endpoint.port);
    endpoint.host = text.substr(0, colon);
    if (endpoint.host.size() > 2 && endpoint.host.front() == '[')
      endpoint.host = endpoint.host.substr(1, colon - 2);
    if (error == std::errc{} && rest == end) return endpoint;
  }
  return BadUsage(fmt::format("{} is not HOST:PORT: '{}'", what, text));
}

void Connect(asio::io_context& io, const Endpoint& endpoint,
             std::function<void(Result<std::shared_ptr<Connection>>)> done) {
  auto attempt = std::make_shared<Attempt>(io);
  const std::string name = fmt::format("{}:{}", endpoint.host, endpoint.port);
  attempt->timer.expires_after(std::chrono::seconds(10));
  attempt->timer.async_wait([attempt](const ErrorCode& error) {
    if (error) return;
    attempt->timed_out = true;
    attempt->resolver.cancel();
    ErrorCode ignored;
    attempt->socket.close(ignored);
  });
  auto finish = [attempt, name, done = std::move(done)](const ErrorCode& error) {
    attempt->timer.cancel();
    if (!error) return done(std::make_shared<TcpConnection>(std::move(attempt->socket)));
    done(Fail(fmt::format("cannot reach {}: {}", name, attempt->timed_out ? "no answer" : error.message())));
  };
  attempt->resolver.async_resolve(
      endpoint.host, std::to_string(endpoint.port),
      [attempt, finish](const ErrorCode& error, tcp::resolver::results_type found) {
        if (error) return finish(error);
        asio::async_connect(attempt->socket, found,
                            [finish](const ErrorCode& e, const tcp::endpoint&) { finish(e); });
      });
}

Result<std::unique_ptr<Listener>> Listener::Open(asio::io_context& io, const Endpoint& endpoint,
                                                 OnConnection on_connection) {
  const std::string name = fmt::format("{}:{}", endpoint.host, endpoint.port);
  ErrorCode error;
  const auto found = tcp::resolver(io).resolve(endpoint.host, std::to_string(endpoint.port), error);
  if (error || found.empty()) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  const tcp::endpoint address = found.begin()->endpoint();
  if (!address.address().is_loopback())
    return BadUsage(
        fmt::format("will not listen at {}: connections are not encrypted yet, so only loopback addresses "
                    "(127.0.0.1, ::1) are served; use an SSH tunnel between machines",
                    name));
  tcp::acceptor acceptor(io);
  acceptor.open(address.protocol(), error);
  if (!error) acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor.bind(address, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  return std::make_unique<TcpListener>(std::move(acceptor), std::move(on_connection));
}

}  // namespace quarry

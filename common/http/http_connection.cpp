#include "common/http/http_connection.h"

#include <fmt/format.h>
#include <openssl/ssl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/core/tcp_stream.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/ssl/ssl_stream.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <type_traits>
#include <utility>

#include "common/http/http_message.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;
using TlsStream = beast::ssl_stream<beast::tcp_stream>;
using Request = http::request<http::empty_body>;

/// Limit for a request's headers in bytes. Cookies of other servers of the same host come with every request;
/// nginx takes 32 KiB, of which 8 KiB in one line.
constexpr uint32_t kMostHeadBytes = 16 << 10;
/// Limit for a connection's buffer in bytes: headers and the beginning of a next request.
constexpr size_t kMostBufferBytes = kMostHeadBytes + (4 << 10);
/// Limit for the peer's own close after the last answer. A close with unread bytes would reset the
/// connection, and the peer could lose the answer.
constexpr auto kFarewellTime = std::chrono::seconds(1);

template <class Stream>
Stream MakeStream(tcp::socket socket, const HttpService& service) {
  if constexpr (std::is_same_v<Stream, TlsStream>) {
    SSL_CTX_up_ref(service.tls.get());
    asio::ssl::context context(service.tls.get());
    return TlsStream(std::move(socket), context);
  } else {
    return Stream(std::move(socket));
  }
}

bool IsLoopback(const asio::ip::address& address) {
  if (address.is_v6() && address.to_v6().is_v4_mapped())
    return asio::ip::make_address_v4(asio::ip::v4_mapped, address.to_v6()).is_loopback();
  return address.is_loopback();
}

std::string ToString(beast::string_view text) { return {text.data(), text.size()}; }

/// A connection until it ends or becomes a WebSocket, one request at a time. Stream is beast::tcp_stream or
/// TlsStream.
template <class Stream>
class HttpConnection final : public ServedConnection,
                             public std::enable_shared_from_this<HttpConnection<Stream>> {
  static constexpr bool kTls = std::is_same_v<Stream, TlsStream>;

 public:
  HttpConnection(tcp::socket socket, std::shared_ptr<HttpService> service)
      : service_(std::move(service)),
        stream_(MakeStream<Stream>(std::move(socket), *service_)),
        buffer_(kMostBufferBytes) {
    ErrorCode error;
    tcp_stream().socket().set_option(tcp::no_delay(true), error);
    const auto remote = tcp_stream().socket().remote_endpoint(error);
    if (error) return;
    const std::string host = remote.address().to_string();
    peer_ = fmt::format(fmt::runtime(remote.address().is_v6() ? "[{}]:{}" : "{}:{}"), host, remote.port());
    loopback_ = IsLoopback(remote.address());
  }

  void Run() {
    if constexpr (kTls) {
      tcp_stream().expires_after(Seconds(times().handshake_s));
      stream_.async_handshake(asio::ssl::stream_base::server, [self = Self()](const ErrorCode& error) {
        if (self->closed_) return;
        if (error) return self->Drop();
        self->AwaitRequest();
      });
    } else {
      AwaitRequest();
    }
  }

  bool closed() const override { return closed_; }
  bool web_socket() const override { return false; }
  Clock::time_point active() const override { return active_; }
  void Drop() override {
    if (std::exchange(closed_, true)) return;
    tcp_stream().close();
  }

 private:
  std::shared_ptr<HttpConnection> Self() { return this->shared_from_this(); }
  beast::tcp_stream& tcp_stream() { return beast::get_lowest_layer(stream_); }
  const HttpTimes& times() const { return service_->options.times; }

  void AwaitRequest() {
    active_ = Clock::now();
    if (buffer_.size() > 0) return ReadRequest();
    tcp_stream().expires_after(Seconds(times().idle_s));
    stream_.async_read_some(buffer_.prepare(4 << 10), [self = Self()](const ErrorCode& error, size_t size) {
      if (self->closed_) return;
      if (error) return self->Drop();
      self->buffer_.commit(size);
      self->ReadRequest();
    });
  }

  void ReadRequest() {
    parser_.emplace();
    parser_->header_limit(kMostHeadBytes);
    tcp_stream().expires_after(Seconds(times().request_s));
    http::async_read_header(stream_, buffer_, *parser_,
                            [self = Self()](const ErrorCode& error, size_t head_bytes) {
                              if (self->closed_) return;
                              if (error) return self->RefuseHead(error);
                              self->OnRequest(head_bytes);
                            });
  }

  void RefuseHead(const ErrorCode& error) {
    if (error == http::error::header_limit || error == http::error::buffer_overflow) return RefuseLongHead();
    const bool broken = error.category() == http::make_error_code(http::error::bad_version).category() &&
                        error != http::error::end_of_stream && error != http::error::partial_message;
    if (!broken) return Drop();
    Refuse({400, "text/plain; charset=utf-8", fmt::format("not a request: {}\n", error.message()), {}});
  }
  void RefuseLongHead() {
    Refuse({431,
            "text/plain; charset=utf-8",
            fmt::format("headers of a request take at most {} bytes\n", kMostHeadBytes),
            {}});
  }
  void Refuse(HttpResponse answer) { Answer(std::move(answer), false); }

  void OnRequest(size_t head_bytes) {
    active_ = Clock::now();
    // The parser's limit starts again behind what it has parsed of headers that come in pieces.
    if (head_bytes > kMostHeadBytes) return RefuseLongHead();
    const Request& request = parser_->get();
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return Refuse({405, "text/plain; charset=utf-8", "GET and HEAD only\n", {{"Allow", "GET, HEAD"}}});
    HttpRequest head;
    if (!parser_->is_done())
      return Refuse({400, "text/plain; charset=utf-8", "a request with a body is not taken\n", {}});
    const beast::string_view target = request.target();
    if (!SplitTarget({target.data(), target.size()}, head))
      return Refuse({400, "text/plain; charset=utf-8", "a request names a path that begins with '/'\n", {}});
    head.method = ToString(request.method_string());
    for (const auto& field : request)
      head.headers.emplace_back(LowerCase(ToString(field.name_string())), ToString(field.value()));
    head.peer = peer_;
    head.loopback = loopback_;
    if (service_->handlers.may_upgrade && beast::websocket::is_upgrade(request))
      return Upgrade(std::move(head));
    HttpResponse answer = service_->handlers.on_request(head);
    if (!closed_) Answer(std::move(answer), parser_->keep_alive());
  }

  void Upgrade(HttpRequest head) {
    // Frames before the answer would be lost, because the WebSocket starts with an empty buffer.
    if (buffer_.size() > 0)
      return Refuse({400, "text/plain; charset=utf-8", "a WebSocket begins after the answer\n", {}});
    HttpResponse answer = service_->handlers.may_upgrade(head);
    if (closed_) return;
    if (answer.status != 101) return Answer(std::move(answer), parser_->keep_alive());
    closed_ = true;
    tcp_stream().expires_never();
    AcceptWebSocket<Stream, Request>(std::move(stream_), parser_->get(), std::move(head), service_);
  }

  void Answer(HttpResponse answer, bool keep) {
    const auto headers = AnswerHeaders(answer);
    file_ = std::move(answer.file);
    if (file_) {
      const auto* from = reinterpret_cast<const char*>(file_->data());
      return Send(file_response_, answer.status, headers, {from, file_->size()}, keep);
    }
    Send(response_, answer.status, headers, std::move(answer.body), keep);
  }

  /// A request that asks for the head alone gets no body.
  template <class Response>
  void Send(Response& response, int status, const std::vector<std::pair<std::string, std::string>>& headers,
            typename Response::body_type::value_type body, bool keep) {
    const size_t bytes = body.size();
    response = {};
    // A request that could not be parsed may have no version.
    response.version(parser_->is_header_done() ? parser_->get().version() : 11);
    for (const auto& [name, value] : headers) response.insert(name, value);
    response.result(static_cast<unsigned>(status));
    response.content_length(bytes);
    response.keep_alive(keep);
    if (parser_->get().method() != http::verb::head) response.body() = std::move(body);
    constexpr double kSlowLine = 16 << 10;  // bytes a second of a file that a peer takes at least
    const double more_s = file_ ? static_cast<double>(bytes) / kSlowLine : 0;
    tcp_stream().expires_after(Seconds(times().answer_s + more_s));
    http::async_write(stream_, response, [self = Self(), keep](const ErrorCode& error, size_t) {
      self->file_.reset();
      if (self->closed_) return;
      if (error) return self->Drop();
      if (keep) return self->AwaitRequest();
      self->SayFarewell();
    });
  }

  void SayFarewell() {
    active_ = Clock::now();
    tcp_stream().expires_after(kFarewellTime);
    if constexpr (kTls) {
      stream_.async_shutdown([self = Self()](const ErrorCode&) { self->Drain(); });
    } else {
      Drain();
    }
  }

  void Drain() {
    if (closed_) return;
    ErrorCode ignored;
    tcp_stream().socket().shutdown(tcp::socket::shutdown_send, ignored);
    DrainMore();
  }

  void DrainMore() {
    tcp_stream().async_read_some(asio::buffer(rest_), [self = Self()](const ErrorCode& error, size_t) {
      if (self->closed_) return;
      if (error) return self->Drop();
      self->DrainMore();
    });
  }

  const std::shared_ptr<HttpService> service_;
  Stream stream_;
  beast::flat_buffer buffer_;
  std::string peer_ = "?";
  bool loopback_ = false;
  std::optional<http::request_parser<http::empty_body>> parser_;
  http::response<http::string_body> response_;
  http::response<http::span_body<const char>> file_response_;
  std::shared_ptr<const Bytes> file_;  ///< that an answer on its way has
  std::array<char, 4096> rest_;        ///< receives bytes that are dropped after the last answer
  Clock::time_point active_ = Clock::now();
  bool closed_ = false;
};

template <class Stream>
void Serve(tcp::socket socket, std::shared_ptr<HttpService> service) {
  auto connection = std::make_shared<HttpConnection<Stream>>(std::move(socket), service);
  service->connections.push_back(connection);
  connection->Run();
}

}  // namespace

void ServeConnection(asio::io_context& io, int socket, std::shared_ptr<HttpService> service) {
  sockaddr_storage address{};
  socklen_t size = sizeof address;
  const bool v6 = ::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size) == 0 &&
                  address.ss_family == AF_INET6;
  tcp::socket stream(io, v6 ? tcp::v6() : tcp::v4(), socket);
  if (service->tls) {
    Serve<TlsStream>(std::move(stream), std::move(service));
  } else {
    Serve<beast::tcp_stream>(std::move(stream), std::move(service));
  }
}

}  // namespace quarry

#include "common/http/http_connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket/rfc6455.hpp>
#include <optional>
#include <utility>

#include "common/http/http_message.h"
#include "common/http/served_stream.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
using ErrorCode = boost::system::error_code;
using Request = http::request<http::empty_body>;

/// Limit for a request's headers in bytes. Every request also carries the cookies of other servers on the
/// same host. nginx accepts 32 KiB, at most 8 KiB a line.
constexpr uint32_t kMostHeadBytes = 16 << 10;
/// Limit for a connection's buffer in bytes: headers and the beginning of a next request.
constexpr size_t kMostBufferBytes = kMostHeadBytes + (4 << 10);
/// Limit for the peer's own close after the last answer. A close with unread bytes would reset the
/// connection, and the peer could lose the answer.
constexpr auto kFarewellTime = std::chrono::seconds(1);

std::string ToString(beast::string_view text) { return {text.data(), text.size()}; }

/// A connection until it ends or becomes a WebSocket, one request at a time.
class HttpConnection final : public ServedConnection, public std::enable_shared_from_this<HttpConnection> {
 public:
  HttpConnection(ServedStream stream, std::shared_ptr<HttpService> service)
      : service_(std::move(service)),
        stream_(std::move(stream)),
        buffer_(kMostBufferBytes),
        peer_(stream_.PeerAddress(loopback_)) {}

  void Run() {
    if (!service_->tls) return AwaitRequest();
    stream_.ExpiresAfter(Seconds(times().handshake_s));
    stream_.Handshake([self = Self()](const ErrorCode& error, size_t) {
      if (self->closed_) return;
      if (error) return self->Drop();
      self->AwaitRequest();
    });
  }

  bool closed() const override { return closed_; }
  bool web_socket() const override { return false; }
  Clock::time_point active() const override { return active_; }
  void Drop() override {
    if (std::exchange(closed_, true)) return;
    stream_.Close();
  }

 private:
  std::shared_ptr<HttpConnection> Self() { return shared_from_this(); }
  const HttpTimes& times() const { return service_->options.times; }

  void AwaitRequest() {
    active_ = Clock::now();
    if (buffer_.size() > 0) return ReadRequest();
    stream_.ExpiresAfter(Seconds(times().idle_s));
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
    stream_.ExpiresAfter(Seconds(times().request_s));
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
    // The parser's limit does not cover the whole head: it starts again after each piece that arrives.
    if (head_bytes > kMostHeadBytes) return RefuseLongHead();
    const Request& request = parser_->get();
    if (request.method() != http::verb::get && request.method() != http::verb::head)
      return Refuse({405, "text/plain; charset=utf-8", "GET and HEAD only\n", {{"Allow", "GET, HEAD"}}});
    HttpRequest head;
    if (!parser_->is_done())
      return Refuse({400, "text/plain; charset=utf-8", "requests with a body are not accepted\n", {}});
    const beast::string_view target = request.target();
    if (!SplitTarget({target.data(), target.size()}, head))
      return Refuse({400, "text/plain; charset=utf-8", "the path of a request must begin with '/'\n", {}});
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
      return Refuse({400, "text/plain; charset=utf-8", "a WebSocket may send only after the answer\n", {}});
    HttpResponse answer = service_->handlers.may_upgrade(head);
    if (closed_) return;
    if (answer.status != 101) return Answer(std::move(answer), parser_->keep_alive());
    closed_ = true;
    stream_.ExpiresNever();
    AcceptWebSocket(std::move(stream_), parser_->get(), std::move(head), service_);
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

  /// A HEAD request gets no body.
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
    constexpr double kSlowLine = 16 << 10;  // least bytes a second that a peer takes of a file
    const double more_s = file_ ? static_cast<double>(bytes) / kSlowLine : 0;
    stream_.ExpiresAfter(Seconds(times().answer_s + more_s));
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
    stream_.ExpiresAfter(kFarewellTime);
    if (!service_->tls) return Drain();
    stream_.TakeLeave([self = Self()](const ErrorCode&, size_t) { self->Drain(); });
  }

  void Drain() {
    if (closed_) return;
    stream_.StopSending();
    DrainMore();
  }

  void DrainMore() {
    stream_.ReadBelow(asio::buffer(rest_), [self = Self()](const ErrorCode& error, size_t) {
      if (self->closed_) return;
      if (error) return self->Drop();
      self->DrainMore();
    });
  }

  const std::shared_ptr<HttpService> service_;
  ServedStream stream_;
  beast::flat_buffer buffer_;
  bool loopback_ = false;
  std::string peer_;
  std::optional<http::request_parser<http::empty_body>> parser_;
  http::response<http::string_body> response_;
  http::response<http::span_body<const char>> file_response_;
  std::shared_ptr<const Bytes> file_;  ///< of the answer that is being sent
  std::array<char, 4096> rest_;        ///< receives bytes that are dropped after the last answer
  Clock::time_point active_ = Clock::now();
  bool closed_ = false;
};

}  // namespace

void ServeConnection(asio::io_context& io, int socket, std::shared_ptr<HttpService> service) {
  auto connection = std::make_shared<HttpConnection>(ServedStream(io, socket, service->tls.get()), service);
  service->connections.push_back(connection);
  connection->Run();
}

}  // namespace quarry

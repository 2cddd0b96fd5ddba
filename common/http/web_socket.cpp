#include <fmt/format.h>

#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket.hpp>
#include <deque>
#include <utility>

#include "common/http/http_connection.h"
#include "common/http/served_stream.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace websocket = boost::beast::websocket;
using ErrorCode = boost::system::error_code;

/// A queued message: text, or bytes that others may share.
struct Outgoing {
  std::string text;
  std::shared_ptr<const Bytes> bytes;  ///< null for a text
  std::function<void()> taken;         ///< may be empty

  size_t size() const { return bytes ? bytes->size() : text.size(); }
  asio::const_buffer buffer() const { return bytes ? asio::buffer(*bytes) : asio::buffer(text); }
};

class StreamWebSocket final : public WebSocket,
                              public ServedConnection,
                              public std::enable_shared_from_this<StreamWebSocket> {
 public:
  StreamWebSocket(ServedStream stream, const std::string& peer, std::shared_ptr<HttpService> service)
      : service_(std::move(service)),
        socket_(std::move(stream)),
        deadline_(socket_.get_executor()),
        peer_(peer) {
    const HttpTimes& times = service_->options.times;
    websocket::stream_base::timeout limits{};
    limits.handshake_timeout = Seconds(times.closing_s);
    limits.idle_timeout = Seconds(times.socket_silence_s);
    limits.keep_alive_pings = true;
    socket_.set_option(limits);
    // Beast adds its own version where there is none.
    socket_.set_option(websocket::stream_base::decorator(
        [](websocket::response_type& answer) { answer.set(beast::http::field::server, "quarry"); }));
    socket_.read_message_max(service_->options.most_message_bytes);
    // Messages are complete in memory, so fragments would only cost time.
    socket_.auto_fragment(false);
  }

  template <class Request>
  void Accept(const Request& request, HttpRequest head) {
    socket_.async_accept(request, [self = Self(), head = std::move(head)](const ErrorCode& error) {
      if (self->closed_) return;
      if (error) return self->Drop();
      self->service_->handlers.on_socket(self, head);
    });
  }

  void Start(std::function<void(std::string)> on_text, std::function<void(const Error&)> on_close) override {
    if (closed_ || closing_) return;
    on_text_ = std::move(on_text);
    on_close_ = std::move(on_close);
    Read();
  }
  void SendText(std::string text) override { Send({std::move(text), nullptr, {}}); }
  void SendBinary(std::shared_ptr<const Bytes> message, std::function<void()> taken) override {
    Send({{}, std::move(message), std::move(taken)});
  }
  void Close() override {
    on_text_ = nullptr;
    on_close_ = nullptr;
    BeginClose(websocket::close_code::normal);
  }
  uint64_t queued_bytes() const override { return queued_; }
  const std::string& peer() const override { return peer_; }

  bool closed() const override { return closed_; }
  bool web_socket() const override { return true; }
  Clock::time_point active() const override { return Clock::now(); }
  void Drop() override {
    on_close_ = nullptr;
    Finish({});
  }

 private:
  std::shared_ptr<StreamWebSocket> Self() { return shared_from_this(); }

  void Read() {
    socket_.async_read(incoming_, [self = Self()](const ErrorCode& error, size_t) { self->OnRead(error); });
  }

  void OnRead(const ErrorCode& error) {
    if (closed_) return;
    if (error) return Finish(Sentence(error));
    if (!closing_ && !socket_.got_text()) return RefuseBinary();
    std::string text = closing_ ? "" : beast::buffers_to_string(incoming_.data());
    incoming_.consume(incoming_.size());
    if (on_text_) {
      // Moved out for the call: a Close() within it releases the handler.
      auto on_text = std::exchange(on_text_, nullptr);
      on_text(std::move(text));
      if (!closed_ && !closing_) on_text_ = std::move(on_text);
    }
    if (!closed_) Read();
  }

  void RefuseBinary() {
    on_text_ = nullptr;
    incoming_.consume(incoming_.size());
    const auto on_close = std::exchange(on_close_, nullptr);
    BeginClose(websocket::close_code::unknown_data);
    if (on_close) on_close({fmt::format("{} sends a binary message, where only text is taken", peer_)});
    if (!closed_) Read();
  }

  /// The rest of a sentence that begins with the peer's name: why the connection ends.
  std::string Sentence(const ErrorCode& error) const {
    if (error == websocket::error::closed || error == asio::error::eof) return "closed the connection";
    if (error == beast::error::timeout)
      return fmt::format("is dropped: silent for {} s", service_->options.times.socket_silence_s);
    if (error == websocket::error::message_too_big)
      return fmt::format("sends a message of more than {} bytes", service_->options.most_message_bytes);
    if (error == websocket::error::bad_frame_payload) return "sends text that is not UTF-8";
    return fmt::format("is gone: {}", error.message());
  }

  void Send(Outgoing message) {
    if (closing_ || closed_) return;
    queued_ += message.size();
    outgoing_.push_back(std::move(message));
    if (!writing_) Write();
  }

  void Write() {
    writing_ = true;
    socket_.text(!outgoing_.front().bytes);
    socket_.async_write(outgoing_.front().buffer(), [self = Self()](const ErrorCode& error, size_t) {
      self->writing_ = false;
      if (self->closed_) return self->Forget();
      if (error) return self->Finish(self->Sentence(error));
      self->queued_ -= self->outgoing_.front().size();
      const auto taken = std::move(self->outgoing_.front().taken);
      self->outgoing_.pop_front();
      if (!self->outgoing_.empty())
        self->Write();
      else if (self->closing_)
        self->ShakeHands();
      if (taken && !self->closing_ && !self->closed_) taken();
    });
  }

  void BeginClose(websocket::close_code code) {
    if (closed_ || std::exchange(closing_, true)) return;
    code_ = code;
    deadline_.expires_after(Seconds(service_->options.times.closing_s));
    deadline_.async_wait([self = Self()](const ErrorCode& error) {
      if (!error) self->Finish({});
    });
    if (!writing_) ShakeHands();
  }

  void ShakeHands() {
    socket_.async_close(websocket::close_reason(code_),
                        [self = Self()](const ErrorCode&) { self->Finish({}); });
  }

  /// Closes, and calls `on_close` if it is still set. `sentence`: in the form of Sentence().
  void Finish(const std::string& sentence) {
    if (std::exchange(closed_, true)) return;
    deadline_.cancel();
    socket_.next_layer().Close();
    if (!writing_) Forget();
    on_text_ = nullptr;
    // Moved out first: the handler may release this WebSocket.
    if (const auto on_close = std::exchange(on_close_, nullptr))
      on_close({fmt::format("{} {}", peer_, sentence)});
  }
  void Forget() {
    outgoing_.clear();
    queued_ = 0;
  }

  const std::shared_ptr<HttpService> service_;
  websocket::stream<ServedStream, false> socket_;
  beast::flat_buffer incoming_;
  asio::steady_timer deadline_;
  const std::string peer_;
  std::function<void(std::string)> on_text_;
  std::function<void(const Error&)> on_close_;
  std::deque<Outgoing> outgoing_;  ///< the first is being written
  uint64_t queued_ = 0;
  websocket::close_code code_ = websocket::close_code::none;
  bool writing_ = false, closing_ = false, closed_ = false;
};

}  // namespace

template <class Request>
void AcceptWebSocket(ServedStream stream, const Request& request, HttpRequest head,
                     std::shared_ptr<HttpService> service) {
  auto socket = std::make_shared<StreamWebSocket>(std::move(stream), head.peer, service);
  service->connections.push_back(socket);
  socket->Accept(request, std::move(head));
}

template void AcceptWebSocket(ServedStream, const beast::http::request<beast::http::empty_body>&, HttpRequest,
                              std::shared_ptr<HttpService>);

}  // namespace quarry

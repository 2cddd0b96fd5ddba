// Long: one fixture serves all tests of a server.
#include "common/http/http_server.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <atomic>
#include <boost/asio/connect.hpp>
#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/ssl.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/ssl.hpp>
#include <catch2/catch.hpp>
#include <chrono>
#include <cstdlib>
#include <fstream>
#include <future>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "tests/support/skip.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = boost::beast::http;
namespace websocket = boost::beast::websocket;
using asio::ip::tcp;
using Catch::Matchers::Contains;
using ErrorCode = boost::system::error_code;
using Clock = std::chrono::steady_clock;
using namespace std::chrono_literals;

constexpr auto kPatience = 20s;  // for events that must happen; far more than any needs

double Since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

/// Waits until `condition` holds.
template <class Condition>
bool Eventually(Condition condition) {
  const auto start = Clock::now();
  while (!condition()) {
    if (Clock::now() - start > kPatience) return false;
    std::this_thread::sleep_for(2ms);
  }
  return true;
}

/// A server on a thread of its own. It answers each path with the path, and each message of a WebSocket with
/// the same message.
class Served {
 public:
  explicit Served(HttpServerOptions options = {}, HttpServer::Handlers handlers = {}) {
    if (!handlers.on_request)
      handlers.on_request = [this](const HttpRequest& request) { return Echo(request); };
    if (!handlers.may_upgrade)
      handlers.may_upgrade = [](const HttpRequest& request) {
        return request.path == "/live" ? HttpResponse{101, {}, {}, {}}
                                       : HttpResponse{403, "text/plain", "no", {}};
      };
    if (!handlers.on_socket)
      handlers.on_socket = [this](std::shared_ptr<WebSocket> socket, const HttpRequest&) {
        Take(std::move(socket));
      };
    auto opened = HttpServer::Open(io_, std::move(options), std::move(handlers));
    REQUIRE(opened.has_value());
    server_ = std::move(*opened);
    port_ = server_->port();
    thread_ = std::thread([this] { io_.run(); });
  }
  /// Calls `use` on the server's thread.
  template <class Use>
  auto On(Use use) {
    std::packaged_task<std::invoke_result_t<Use>()> task(std::move(use));
    auto done = task.get_future();
    asio::post(io_, [&task] { task(); });
    return done.get();
  }
  ~Served() {
    On([this] {
      sockets_.clear();
      server_ = nullptr;
    });
    work_.reset();
    io_.stop();
    thread_.join();
  }

  void Destroy() {
    On([this] { server_ = nullptr; });
  }

  uint16_t port() const { return port_; }
  /// The newest WebSocket. Use it by On().
  std::shared_ptr<WebSocket> socket() {
    REQUIRE(Eventually([this] { return On([this] { return !sockets_.empty(); }); }));
    return On([this] { return sockets_.back(); });
  }
  HttpRequest last() {
    return On([this] { return last_; });
  }
  std::string closed() {
    const std::lock_guard lock(mutex_);
    return closed_;
  }
  std::atomic<int> requests{0}, texts{0}, closes{0};

 private:
  HttpResponse Echo(const HttpRequest& request) {
    ++requests;
    last_ = request;
    if (request.path == "/none") return {404, "text/plain", "none", {}};
    if (request.path == "/own")
      return {200, "text/css", "", {{"cache-control", "max-age=60"}, {"X-Own", "yes"}}};
    if (request.path == "/split") return {200, "text/plain", "", {{"X-Own", "yes\r\nX-Other: no"}}};
    if (request.path == "/large") return {200, "text/plain", std::string(64 << 20, 'x'), {}};
    return {200, "text/plain; charset=utf-8", request.path, {}};
  }

  void Take(std::shared_ptr<WebSocket> socket) {
    sockets_.push_back(socket);
    socket->Start(
        [this, weak = std::weak_ptr(socket)](std::string text) {
          ++texts;
          if (text == "close") return weak.lock()->Close();
          weak.lock()->SendText("you say " + std::move(text));
        },
        [this](const Error& error) {
          ++closes;
          const std::lock_guard lock(mutex_);
          closed_ = error.message;
        });
  }

  asio::io_context io_{1};
  asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
  std::unique_ptr<HttpServer> server_;
  uint16_t port_ = 0;
  std::vector<std::shared_ptr<WebSocket>> sockets_;
  HttpRequest last_;
  std::mutex mutex_;
  std::string closed_;  // guarded by mutex_
  std::thread thread_;
};

/// A plain connection that sends text as it is.
class Client {
 public:
  explicit Client(uint16_t port, bool small_window = false) : socket_(io_) {
    socket_.open(tcp::v4());
    if (small_window) socket_.set_option(asio::socket_base::receive_buffer_size(4096));
    socket_.connect({asio::ip::address_v4::loopback(), port});
  }
  ErrorCode Send(const std::string& text) {
    ErrorCode error;
    asio::write(socket_, asio::buffer(text), error);
    return error;
  }
  /// An answer; of a HEAD request without its body.
  http::response<http::string_body> Receive(bool head = false) {
    http::response_parser<http::string_body> parser;
    parser.skip(head);
    ErrorCode error;
    http::read(socket_, buffer_, parser, error);
    INFO(error.message());
    REQUIRE_FALSE(error);
    return parser.release();
  }
  http::response<http::string_body> Ask(const std::string& text, bool head = false) {
    REQUIRE_FALSE(Send(text));
    return Receive(head);
  }
  /// Waits for the server to close. Returns: the bytes that it sent before.
  std::string Rest() {
    std::string rest = beast::buffers_to_string(buffer_.data());
    ErrorCode error;
    asio::read(socket_, asio::dynamic_buffer(rest), error);
    CHECK((error == asio::error::eof || error == asio::error::connection_reset));
    return rest;
  }
  tcp::socket& socket() { return socket_; }

 private:
  asio::io_context io_;
  tcp::socket socket_;
  beast::flat_buffer buffer_;
};

std::string Get(const std::string& path, const std::string& more = "") {
  return fmt::format("GET {} HTTP/1.1\r\nHost: localhost\r\n{}\r\n", path, more);
}

std::string Field(const http::response<http::string_body>& answer, const char* name) {
  const auto value = answer[name];
  return {value.data(), value.size()};
}

/// A WebSocket of a client, over a plain connection.
struct SocketClient {
  explicit SocketClient(uint16_t port, const std::string& path = "/live", bool small_window = false)
      : socket(io) {
    auto& tcp_socket = socket.next_layer().socket();
    tcp_socket.open(tcp::v4());
    if (small_window) tcp_socket.set_option(asio::socket_base::receive_buffer_size(4096));
    tcp_socket.connect({asio::ip::address_v4::loopback(), port});
    socket.handshake(answer, "localhost", path, error);
  }
  std::string Read() {
    beast::flat_buffer buffer;
    socket.read(buffer, error);
    return beast::buffers_to_string(buffer.data());
  }
  /// Reads until the server ends the connection. Returns: its reason.
  uint16_t Reason() {
    while (!error) Read();
    return socket.reason().code;
  }

  asio::io_context io;
  websocket::stream<beast::tcp_stream> socket;
  websocket::response_type answer;
  ErrorCode error;
};

HttpServerOptions WithTimes(HttpTimes times) {
  HttpServerOptions options;
  options.times = times;
  return options;
}

/// A certificate for localhost and its key. Empty, after telling so, when there is no openssl program.
TlsFiles MakeCertificate(const test::TemporaryFolder& folder) {
  const std::string command = fmt::format(
      "cd {} && openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj "
      "/CN=localhost -keyout key.pem -out "
      "cert.pem >/dev/null 2>&1 && chmod 600 key.pem",
      folder.path());
  if (std::system(command.c_str()) == 0) return {folder.file("cert.pem"), folder.file("key.pem")};
  test::Skip("the openssl program is not installed");
  return {};
}

std::string OpenError(HttpServerOptions options, int exit_status) {
  asio::io_context io;
  const auto server = HttpServer::Open(io, std::move(options), {});
  REQUIRE_FALSE(server.has_value());
  CHECK(server.error().exit_status() == exit_status);
  return server.error().message;
}

}  // namespace

TEST_CASE("A request reaches its handler with path, query and headers", "[http_server]") {
  Served served;
  Client client(served.port());
  const auto answer = client.Ask(Get("/a%20b/C?x=%31&y", "X-Twice: 1\r\nx-twice: 2\r\nEmpty:\r\n"));
  CHECK(answer.result_int() == 200);
  CHECK(answer.body() == "/a%20b/C");
  const HttpRequest request = served.last();
  CHECK(request.method == "GET");
  CHECK(request.path == "/a%20b/C");
  CHECK(request.query == "x=%31&y");
  CHECK(request.header("x-twice") == "1, 2");
  CHECK(request.header("host") == "localhost");
  CHECK(request.header("empty").empty());
  CHECK(request.header("missing").empty());
  CHECK(request.loopback);
  CHECK(request.peer == fmt::format("127.0.0.1:{}", client.socket().local_endpoint().port()));
}

TEST_CASE("Every answer has its length, its type, and is neither sniffed nor kept", "[http_server]") {
  Served served;
  Client client(served.port());
  for (const char* path : {"/a", "/none"}) {
    const auto answer = client.Ask(Get(path));
    CHECK(Field(answer, "Content-Length") == std::to_string(answer.body().size()));
    CHECK(Field(answer, "X-Content-Type-Options") == "nosniff");
    CHECK(Field(answer, "Cache-Control") == "no-store");
    CHECK_THAT(Field(answer, "Content-Type"), Contains("text/plain"));
    CHECK(answer.count("Server") == 0);
  }
  const auto own = client.Ask(Get("/own"));
  CHECK(Field(own, "Cache-Control") == "max-age=60");
  CHECK(own.count("Cache-Control") == 1);
  CHECK(Field(own, "X-Own") == "yes");
  CHECK(Field(own, "Content-Length") == "0");
}

TEST_CASE("A line end in a handler's header does not begin another header", "[http_server]") {
  Served served;
  const auto answer = Client(served.port()).Ask(Get("/split"));
  CHECK(answer.result_int() == 500);
  CHECK(answer.count("X-Other") == 0);
}

TEST_CASE("A connection is kept for more requests, also for those sent ahead", "[http_server]") {
  Served served;
  Client client(served.port());
  CHECK(client.Ask(Get("/1")).body() == "/1");
  CHECK(client.Ask(Get("/none")).result_int() == 404);
  REQUIRE_FALSE(client.Send(Get("/2") + Get("/3") + Get("/4", "Connection: close\r\n") + Get("/5")));
  CHECK(client.Receive().body() == "/2");
  CHECK(client.Receive().body() == "/3");
  CHECK(client.Receive().body() == "/4");
  CHECK(client.Rest().empty());
  CHECK(served.requests == 5);
}

TEST_CASE("A request of HTTP/1.0, as nginx sends it, is answered and the connection closed",
          "[http_server]") {
  Served served;
  Client client(served.port());
  const auto answer = client.Ask("GET /old HTTP/1.0\r\nHost: localhost\r\nConnection: close\r\n\r\n");
  CHECK(answer.body() == "/old");
  CHECK(client.Rest().empty());
}

TEST_CASE("HEAD is answered as GET, without the body", "[http_server]") {
  Served served;
  Client client(served.port());
  const auto answer = client.Ask("HEAD /12345 HTTP/1.1\r\nHost: localhost\r\n\r\n", true);
  CHECK(answer.result_int() == 200);
  CHECK(Field(answer, "Content-Length") == "6");
  CHECK(served.last().method == "HEAD");
  // No byte of a body came before the next answer.
  CHECK(client.Ask(Get("/next")).body() == "/next");
}

TEST_CASE("Methods other than GET and HEAD are refused, with a body or without", "[http_server]") {
  Served served;
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "CONNECT", "FROBNICATE"}) {
    Client client(served.port());
    const auto answer = client.Ask(
        fmt::format("{} /a HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\n\r\nhello", method));
    INFO(method);
    CHECK(answer.result_int() == 405);
    CHECK(Field(answer, "Allow") == "GET, HEAD");
    CHECK(client.Rest().empty());
  }
  CHECK(served.requests == 0);
}

TEST_CASE("Bytes that are not a request, or a request with a body, are answered with 400 and closed",
          "[http_server]") {
  Served served;
  for (const std::string& text :
       {std::string("hello\r\n\r\n"), std::string("\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03", 11),
        std::string("GET\r\n\r\n"), std::string("GET / HTTP/2.0\r\n\r\n"),
        std::string("GET / HTTP/1.1\r\nno colon\r\n\r\n"), std::string("GET / HTTP/1.1\r\nA: \x01\r\n\r\n"),
        std::string("GET / HTTP/1.1\r\nContent-Length: x\r\n\r\n"),
        std::string("GET a HTTP/1.1\r\nHost: localhost\r\n\r\n"),
        std::string("GET http://localhost/ HTTP/1.1\r\nHost: localhost\r\n\r\n"),
        Get("/", "Content-Length: 5\r\n") + "hello",
        Get("/", "Transfer-Encoding: chunked\r\n") + "0\r\n\r\n"}) {
    Client client(served.port());
    INFO(text);
    CHECK(client.Ask(text).result_int() == 400);
    CHECK(client.Rest().empty());
  }
  CHECK(served.requests == 0);
}

TEST_CASE("Headers take 16 KiB and no byte more, in one piece or in many", "[http_server]") {
  Served served;
  const auto sized = [](size_t bytes) {
    std::string text = Get("/", "A: " + std::string(100, 'a') + "\r\nB: \r\n");
    text.insert(text.size() - 4, bytes - text.size(), 'b');
    return text;
  };
  CHECK(Client(served.port()).Ask(sized(16 << 10)).result_int() == 200);
  for (const size_t bytes : {(16u << 10) + 1, 17u << 10, 100u << 10}) {
    Client client(served.port());
    client.Send(sized(bytes));
    CHECK(client.Receive().result_int() == 431);
    CHECK(client.Rest().empty());
  }
  // Many short headers: the parser has taken some before the others come.
  Client client(served.port());
  client.Send("GET / HTTP/1.1\r\n");
  for (int i = 0; i < 18; ++i) {
    std::this_thread::sleep_for(2ms);
    if (client.Send(fmt::format("A{}: {}\r\n", i, std::string(1000, 'a')))) break;
  }
  client.Send("\r\n");
  CHECK(client.Receive().result_int() == 431);
  CHECK(served.requests == 1);
}

TEST_CASE("A request that never ends is closed, however its bytes trickle", "[http_server]") {
  HttpTimes times;
  times.request_s = 0.3;
  Served served(WithTimes(times));
  Client client(served.port());
  const auto start = Clock::now();
  REQUIRE_FALSE(client.Send("GET / HTTP/1.1\r\n"));
  while (!client.Send("A: b\r\n") && Since(start) < 10) std::this_thread::sleep_for(20ms);
  CHECK(Since(start) >= 0.3);
  CHECK(Since(start) < 10);
  CHECK(served.requests == 0);
}

TEST_CASE("A connection without a request is closed after its time, and one with requests later",
          "[http_server]") {
  HttpTimes times;
  times.idle_s = 1;
  Served served(WithTimes(times));
  const auto start = Clock::now();
  Client silent(served.port()), asking(served.port());
  for (int i = 0; i < 4; ++i) {
    std::this_thread::sleep_for(300ms);
    CHECK(asking.Ask(Get("/again")).body() == "/again");
  }
  CHECK(Since(start) > 1);
  CHECK(silent.Rest().empty());
  CHECK(asking.Rest().empty());
}

TEST_CASE("A client that does not read its answer is closed", "[http_server]") {
  HttpTimes times;
  times.answer_s = 0.3;
  Served served(WithTimes(times));
  Client client(served.port(), true);
  REQUIRE_FALSE(client.Send(Get("/large")));
  REQUIRE(Eventually([&] { return served.requests == 1; }));
  std::this_thread::sleep_for(600ms);
  CHECK(client.Rest().size() < 64u << 20);
}

TEST_CASE("With all places taken the longest idle connection is closed, and never a WebSocket",
          "[http_server]") {
  HttpServerOptions options;
  options.most_connections = 3;
  std::atomic<int> lines{0};
  options.log = [&](const std::string&) { ++lines; };
  Served served(options);
  SocketClient socket(served.port());
  REQUIRE_FALSE(socket.error);
  Client first(served.port()), second(served.port());
  CHECK(first.Ask(Get("/1")).result_int() == 200);
  CHECK(second.Ask(Get("/2")).result_int() == 200);
  CHECK(first.Ask(Get("/3")).result_int() == 200);
  Client third(served.port());
  CHECK(third.Ask(Get("/4")).result_int() == 200);
  CHECK(second.Rest().empty());
  CHECK(first.Ask(Get("/5")).result_int() == 200);
  // Three WebSockets leave no place.
  SocketClient more(served.port()), most(served.port());
  REQUIRE_FALSE(more.error);
  REQUIRE_FALSE(most.error);
  Client none(served.port());
  CHECK(none.Rest().empty());
  socket.socket.write(asio::buffer(std::string("still here")));
  CHECK(socket.Read() == "you say still here");
  CHECK(lines == 1);
}

TEST_CASE("A WebSocket carries text both ways and bytes to the browser", "[http_server]") {
  Served served;
  SocketClient client(served.port());
  REQUIRE_FALSE(client.error);
  CHECK(client.answer.result_int() == 101);
  CHECK(client.answer.count("Sec-WebSocket-Extensions") == 0);
  for (const std::string& text :
       {std::string("hello"), std::string(), std::string(64 << 10, 'x'), std::string("gr\xc3\xbc\xc3\x9f")}) {
    client.socket.write(asio::buffer(text));
    CHECK(client.Read() == "you say " + text);
    CHECK(client.socket.got_text());
  }
  const auto socket = served.socket();
  auto message = std::make_shared<Bytes>(3 << 20);
  for (size_t i = 0; i < message->size(); ++i) (*message)[i] = static_cast<std::byte>(i * 7);
  served.On([&] {
    socket->SendText("before");
    socket->SendBinary(message);
    socket->SendBinary(std::make_shared<Bytes>());
    socket->SendText("after");
  });
  CHECK(client.Read() == "before");
  CHECK(client.Read() == AsText(*message));
  CHECK(client.socket.got_binary());
  CHECK(client.Read().empty());
  CHECK(client.Read() == "after");
  CHECK(socket->peer() ==
        fmt::format("127.0.0.1:{}", client.socket.next_layer().socket().local_endpoint().port()));
}

TEST_CASE("A WebSocket that the handler refuses gets its answer, and the connection is kept",
          "[http_server]") {
  Served served;
  SocketClient client(served.port(), "/other");
  CHECK(client.error == websocket::error::upgrade_declined);
  const std::string upgrade = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n";
  const std::string key = "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n";
  Client plain(served.port());
  CHECK(plain.Ask(Get("/other", upgrade + key)).result_int() == 403);
  CHECK(plain.Ask(Get("/a")).result_int() == 200);
  CHECK(plain.Ask(Get("/live", upgrade)).result_int() == 400);
  // Frames that are sent ahead of the answer.
  CHECK(Client(served.port()).Ask(Get("/live", upgrade + key) + "\x81").result_int() == 400);
  CHECK(served.closes == 0);
}

TEST_CASE("Without a handler for it no request becomes a WebSocket", "[http_server]") {
  asio::io_context io;
  HttpServer::Handlers handlers;
  handlers.on_request = [](const HttpRequest&) { return HttpResponse{200, "text/plain", "page", {}}; };
  const auto server = HttpServer::Open(io, {}, handlers);
  REQUIRE(server.has_value());
  std::thread thread([&] { io.run(); });
  SocketClient client((*server)->port());
  CHECK(client.error == websocket::error::upgrade_declined);
  const std::string upgrade =
      "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: "
      "AAAAAAAAAAAAAAAAAAAAAA==\r\n";
  CHECK(Client((*server)->port()).Ask(Get("/live", upgrade)).body() == "page");
  io.stop();
  thread.join();
}

TEST_CASE("A WebSocket with a message that is too large, binary or no UTF-8 is closed with the reason",
          "[http_server]") {
  Served served;
  SECTION("too large") {
    SocketClient client(served.port());
    client.socket.write(asio::buffer(std::string((64 << 10) + 1, 'x')));
    CHECK(client.Reason() == websocket::close_code::too_big);
    REQUIRE(Eventually([&] { return served.closes == 1; }));
    CHECK_THAT(served.closed(), Contains("127.0.0.1:") && Contains("more than 65536 bytes"));
  }
  SECTION("too large in pieces") {
    SocketClient client(served.port());
    for (int i = 0; i < 2; ++i) client.socket.write_some(false, asio::buffer(std::string(40 << 10, 'x')));
    CHECK(client.Reason() == websocket::close_code::too_big);
  }
  SECTION("binary") {
    SocketClient client(served.port());
    client.socket.binary(true);
    client.socket.write(asio::buffer(std::string("bytes")));
    CHECK(client.Reason() == websocket::close_code::unknown_data);
    REQUIRE(Eventually([&] { return served.closes == 1; }));
    CHECK_THAT(served.closed(), Contains("sends a binary message"));
  }
  SECTION("no UTF-8") {
    SocketClient client(served.port());
    client.socket.write(asio::buffer(std::string("\xc3(")));
    CHECK(client.Reason() == websocket::close_code::bad_payload);
    REQUIRE(Eventually([&] { return served.closes == 1; }));
    CHECK_THAT(served.closed(), Contains("UTF-8"));
  }
  CHECK(served.texts == 0);
  // Nothing is told twice.
  std::this_thread::sleep_for(50ms);
  CHECK(served.closes <= 1);
}

TEST_CASE("A WebSocket is pinged, and closed when nothing answers", "[http_server]") {
  HttpTimes times;
  times.socket_silence_s = 1;
  Served served(WithTimes(times));
  SocketClient client(served.port());
  REQUIRE_FALSE(client.error);
  int pings = 0;
  client.socket.control_callback([&](websocket::frame_type type, beast::string_view) {
    pings += type == websocket::frame_type::ping;
    if (pings == 3 && type == websocket::frame_type::ping)
      client.socket.next_layer().socket().shutdown(tcp::socket::shutdown_receive);
  });
  const auto start = Clock::now();
  // Reading answers pings by itself.
  client.Read();
  CHECK(pings == 3);
  CHECK(Since(start) > 1.4);
  REQUIRE(Eventually([&] { return served.closes == 1; }));
  CHECK_THAT(served.closed(), Contains("silent for 1 s"));
}

TEST_CASE("Bytes count as queued until a client that does not read takes them", "[http_server]") {
  Served served;
  SocketClient client(served.port(), "/live", true);
  REQUIRE_FALSE(client.error);
  const auto socket = served.socket();
  CHECK(served.On([&] { return socket->queued_bytes(); }) == 0);
  const auto message = std::make_shared<Bytes>(4 << 20);
  constexpr uint64_t kMessages = 8;
  const uint64_t all = kMessages * message->size() + 5;
  CHECK(served.On([&] {
    for (uint64_t i = 0; i < kMessages; ++i) socket->SendBinary(message);
    socket->SendText("after");
    return socket->queued_bytes();
  }) == all);
  // The system takes a few MB by itself.
  std::this_thread::sleep_for(200ms);
  const uint64_t stalled = served.On([&] { return socket->queued_bytes(); });
  CHECK(stalled > all / 2);
  std::this_thread::sleep_for(100ms);
  CHECK(served.On([&] { return socket->queued_bytes(); }) == stalled);
  CHECK(client.Read().size() == message->size());
  for (uint64_t i = 1; i < kMessages; ++i) client.Read();
  CHECK(client.Read() == "after");
  CHECK(Eventually([&] { return served.On([&] { return socket->queued_bytes(); }) == 0; }));
  CHECK(message.use_count() == 1);
}

TEST_CASE("Close sends queued bytes, finishes the closing handshake and calls nobody", "[http_server]") {
  Served served;
  SocketClient client(served.port());
  const auto socket = served.socket();
  served.On([&] {
    socket->SendText("one");
    socket->SendBinary(std::make_shared<Bytes>(1 << 20));
    socket->SendText("two");
    socket->Close();
    socket->SendText("dropped");
    socket->Close();
  });
  client.socket.write(asio::buffer(std::string("not heard any more")));
  CHECK(client.Read() == "one");
  CHECK(client.Read().size() == 1 << 20);
  CHECK(client.Read() == "two");
  CHECK(client.Reason() == websocket::close_code::normal);
  CHECK(client.error == websocket::error::closed);
  CHECK(Eventually([&] { return socket.use_count() == 2; }));  // this one and the fixture's
  CHECK(served.closes == 0);
  CHECK(served.texts == 0);
}

TEST_CASE("A WebSocket may be closed in its own callback", "[http_server]") {
  Served served;
  SocketClient client(served.port());
  client.socket.write(asio::buffer(std::string("close")));
  client.socket.write(asio::buffer(std::string("not heard any more")));
  CHECK(client.Reason() == websocket::close_code::normal);
  CHECK(served.texts == 1);
  CHECK(served.closes == 0);
}

TEST_CASE("Close waits for a client that does not read, and not for long", "[http_server]") {
  HttpTimes times;
  times.closing_s = 0.3;
  Served served(WithTimes(times));
  SocketClient client(served.port(), "/live", true);
  const auto socket = served.socket();
  const auto message = std::make_shared<Bytes>(32 << 20);
  const auto start = Clock::now();
  served.On([&] {
    socket->SendBinary(message);
    socket->SendBinary(message);
    socket->Close();
  });
  CHECK(Eventually([&] { return served.On([&] { return socket->queued_bytes(); }) == 0; }));
  CHECK(Since(start) >= 0.3);
  CHECK(Since(start) < 10);
  CHECK(message.use_count() == 1);
  CHECK(Eventually([&] { return socket.use_count() == 2; }));
}

TEST_CASE("A WebSocket's end is reported once, whether the browser closes it or vanishes", "[http_server]") {
  Served served;
  const bool politely = GENERATE(true, false);
  {
    SocketClient client(served.port());
    REQUIRE_FALSE(client.error);
    if (politely) {
      client.socket.close(websocket::close_code::going_away, client.error);
      CHECK_FALSE(client.error);
    }
  }
  REQUIRE(Eventually([&] { return served.closes == 1; }));
  CHECK_THAT(served.closed(),
             Contains("127.0.0.1:") && (Contains("closed the connection") || Contains("is gone")));
  const auto socket = served.socket();
  // Sending to a closed socket does nothing.
  served.On([&] {
    socket->SendText("late");
    socket->Close();
  });
  CHECK(served.On([&] { return socket->queued_bytes(); }) == 0);
  CHECK(served.closes == 1);
}

TEST_CASE("A destroyed server closes everything and calls nobody", "[http_server]") {
  Served served;
  SocketClient reading(served.port());
  SocketClient stalled(served.port(), "/live", true);
  const auto socket = served.socket();
  served.On([&] {
    for (int i = 0; i < 8; ++i) socket->SendBinary(std::make_shared<Bytes>(4 << 20));
  });
  Client idle(served.port()), half(served.port()), slow(served.port(), true);
  CHECK(idle.Ask(Get("/1")).result_int() == 200);
  REQUIRE_FALSE(half.Send("GET / HT"));
  REQUIRE_FALSE(slow.Send(Get("/large")));
  REQUIRE(Eventually([&] { return served.requests == 2; }));
  served.Destroy();
  CHECK(idle.Rest().empty());
  CHECK(half.Rest().empty());
  CHECK(slow.Rest().size() < 64u << 20);
  CHECK(reading.Read().empty());
  CHECK(reading.error);
  served.On([&] { socket->SendText("late"); });
  CHECK(served.On([&] { return socket->queued_bytes(); }) == 0);
  CHECK(served.closes == 0);
  CHECK(served.requests == 2);
  asio::io_context io;
  ErrorCode error;
  tcp::socket(io).connect({asio::ip::address_v4::loopback(), served.port()}, error);
  CHECK(error == asio::error::connection_refused);
}

TEST_CASE("A server that is destroyed while connections come harms nobody", "[http_server]") {
  asio::io_context io;
  HttpServer::Handlers handlers;
  handlers.on_request = [](const HttpRequest&) -> HttpResponse { throw std::logic_error("called"); };
  auto server = HttpServer::Open(io, {}, handlers);
  REQUIRE(server.has_value());
  Client waiting((*server)->port()), other((*server)->port());
  REQUIRE_FALSE(waiting.Send(Get("/")));
  for (int polls = 0; polls < 3; ++polls) io.poll_one();
  server->reset();
  io.poll();
  CHECK(waiting.Rest().empty());
  CHECK(other.Rest().empty());
}

TEST_CASE("HTTPS carries requests and WebSockets, and plain requests end", "[http_server]") {
  const test::TemporaryFolder folder;
  HttpServerOptions options;
  options.tls = MakeCertificate(folder);
  if (options.tls.cert.empty()) return;
  Served served(options);
  asio::io_context io;
  asio::ssl::context context(asio::ssl::context::tls_client);
  context.load_verify_file(options.tls.cert);
  context.set_verify_mode(asio::ssl::verify_peer);
  {
    websocket::stream<beast::ssl_stream<tcp::socket>> client(io, context);
    auto& tls = client.next_layer();
    tls.next_layer().connect({asio::ip::address_v4::loopback(), served.port()});
    tls.handshake(asio::ssl::stream_base::client);
    http::write(tls, http::request<http::empty_body>(http::verb::get, "/secret", 11));
    beast::flat_buffer buffer;
    http::response<http::string_body> answer;
    http::read(tls, buffer, answer);
    CHECK(answer.body() == "/secret");
    client.handshake("localhost", "/live");
    const auto message = std::make_shared<Bytes>(1 << 20, std::byte{7});
    const auto socket = served.socket();
    served.On([&] { socket->SendBinary(message); });
    client.read(buffer);
    CHECK(beast::buffers_to_string(buffer.data()) == AsText(*message));
    buffer.clear();
    client.write(asio::buffer(std::string("hello")));
    client.read(buffer);
    CHECK(beast::buffers_to_string(buffer.data()) == "you say hello");
    ErrorCode ignored;
    client.close(websocket::close_code::normal, ignored);
  }
  {
    beast::ssl_stream<tcp::socket> old(io, context);
    SSL_set_max_proto_version(old.native_handle(), TLS1_1_VERSION);
    old.next_layer().connect({asio::ip::address_v4::loopback(), served.port()});
    ErrorCode error;
    old.handshake(asio::ssl::stream_base::client, error);
    CHECK(error);
  }
  Client plain(served.port());
  REQUIRE_FALSE(plain.Send(Get("/")));
  CHECK_THAT(plain.Rest(), !Contains("HTTP"));
  CHECK(served.requests == 1);
}

TEST_CASE("A TLS handshake that stalls is closed", "[http_server]") {
  const test::TemporaryFolder folder;
  HttpTimes times;
  times.handshake_s = 0.3;
  HttpServerOptions options = WithTimes(times);
  options.tls = MakeCertificate(folder);
  if (options.tls.cert.empty()) return;
  Served served(options);
  const auto start = Clock::now();
  CHECK(Client(served.port()).Rest().empty());
  CHECK(Since(start) >= 0.2);
}

TEST_CASE("TLS files that cannot be used are named", "[http_server]") {
  const test::TemporaryFolder folder;
  HttpServerOptions options;
  const auto with = [&](const std::string& cert, const std::string& key) {
    options.tls = {cert, key};
    return options;
  };
  CHECK_THAT(OpenError(with("cert.pem", ""), 2), Contains("go together"));
  CHECK_THAT(OpenError(with("", "key.pem"), 2), Contains("go together"));
  CHECK_THAT(OpenError(with("/no/such/cert", "/no/such/key"), 2), Contains("/no/such/cert: cannot open"));
  const TlsFiles files = MakeCertificate(folder);
  if (files.cert.empty()) return;
  CHECK_THAT(OpenError(with(files.cert, "/no/such/key"), 2), Contains("/no/such/key: cannot open"));
  CHECK_THAT(OpenError(with(files.cert, folder.path()), 2), Contains("is not a regular file"));
  for (const mode_t mode : {0640, 0604}) {
    REQUIRE(::chmod(files.key.c_str(), mode) == 0);
    CHECK_THAT(OpenError(with(files.cert, files.key), 2), Contains(files.key) && Contains("chmod 600"));
  }
  REQUIRE(::chmod(files.key.c_str(), 0600) == 0);
  REQUIRE(::chmod(files.cert.c_str(), 0600) == 0);
  CHECK_THAT(OpenError(with(files.cert, files.cert), 2), Contains("not a private key"));
  CHECK_THAT(OpenError(with(files.key, files.key), 2), Contains("not a certificate"));
}

TEST_CASE("An address beyond loopback is served with TLS only", "[http_server]") {
  HttpServerOptions options;
  for (const char* host : {"0.0.0.0", "::"}) {
    options.listen = {host, 0};
    CHECK_THAT(OpenError(options, 2), Contains("--tls-cert and --tls-key"));
  }
  const test::TemporaryFolder folder;
  options.listen = {"0.0.0.0", 0};
  options.tls = MakeCertificate(folder);
  if (options.tls.cert.empty()) return;
  asio::io_context io;
  CHECK(HttpServer::Open(io, options, {}).has_value());
}

TEST_CASE("An address that is in use or of another machine is refused", "[http_server]") {
  Served served;
  HttpServerOptions options;
  options.listen = {"127.0.0.1", served.port()};
  CHECK_THAT(OpenError(options, 1),
             Contains(fmt::format("127.0.0.1:{}: the address is in use", served.port())));
  options.listen = {"no-such-host.invalid", 0};
  CHECK_THAT(OpenError(options, 1), Contains("cannot listen at no-such-host.invalid:0"));
}

}  // namespace quarry

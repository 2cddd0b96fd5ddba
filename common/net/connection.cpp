#include "common/net/connection.h"

#include <fmt/format.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <deque>
#include <utility>

#include "common/net/stream_connection.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

constexpr size_t kMaxNewcomers = 64;

class TcpListener final : public Listener {
 public:
  TcpListener(asio::io_context& io, tcp::acceptor acceptor, Security security, OnConnection on_connection)
      : io_(io),
        acceptor_(std::move(acceptor)),
        pause_(acceptor_.get_executor()),
        security_(std::move(security)),
        on_connection_(std::move(on_connection)) {
    Accept();
  }
  uint16_t port() const override { return acceptor_.local_endpoint().port(); }

 private:
  void Accept() {
    acceptor_.async_accept([this](const ErrorCode& error, tcp::socket socket) {
      if (error == asio::error::operation_aborted) return;
      if (error) return AcceptLater();
      DropOldNewcomers();
      auto connection = MakeConnection(io_, socket.release(), security_, {});
      newcomers_.push_back(connection);
      on_connection_(connection);
      Accept();
    });
  }

  /// No more files may be opened, say.
  void AcceptLater() {
    pause_.expires_after(std::chrono::milliseconds(100));
    pause_.async_wait([this](const ErrorCode& error) {
      if (!error) Accept();
    });
  }

  /// Makes place for one more: whoever has been silent for longest goes.
  void DropOldNewcomers() {
    std::erase_if(newcomers_, [](const std::weak_ptr<AcceptedConnection>& weak) {
      const auto connection = weak.lock();
      return !connection || !connection->newcomer();
    });
    while (newcomers_.size() >= kMaxNewcomers) {
      const auto oldest = newcomers_.front().lock();
      newcomers_.pop_front();
      if (oldest) oldest->Drop(fmt::format("is dropped: {} others wait to be greeted", kMaxNewcomers), false);
    }
  }

  asio::io_context& io_;
  tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  Security security_;
  OnConnection on_connection_;
  std::deque<std::weak_ptr<AcceptedConnection>> newcomers_;
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

void Connect(asio::io_context& io, const Endpoint& endpoint, const Security& security,
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
  auto finish = [&io, attempt, name, security, host = endpoint.host,
                 done = std::move(done)](const ErrorCode& error) {
    attempt->timer.cancel();
    if (!error && !attempt->timed_out)
      return done(MakeConnection(io, attempt->socket.release(), security, host));
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
                                                 const Security& security, OnConnection on_connection) {
  const std::string name = fmt::format("{}:{}", endpoint.host, endpoint.port);
  ErrorCode error;
  const auto found = tcp::resolver(io).resolve(endpoint.host, std::to_string(endpoint.port), error);
  if (error || found.empty()) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  const tcp::endpoint address = found.begin()->endpoint();
  if (!security.tls() && !address.address().is_loopback())
    return BadUsage(
        fmt::format("will not listen at {}, which is not a loopback address, without encryption; give "
                    "--secret-file F, the same on every machine ('openssl rand -hex 32' makes a secret), or "
                    "--tls-cert, --tls-key and --tls-ca",
                    name));
  tcp::acceptor acceptor(io);
  acceptor.open(address.protocol(), error);
  if (!error) acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor.bind(address, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  return std::make_unique<TcpListener>(io, std::move(acceptor), security, std::move(on_connection));
}

}  // namespace quarry

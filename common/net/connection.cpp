#include "common/net/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "common/base/resource.h"
#include "common/net/acceptor.h"
#include "common/net/stream_connection.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

// Accepted connections whose first message has not come yet; above this the oldest is dropped.
constexpr size_t kMaxNewcomers = 64;
/// Pause between accepts while each new connection makes another drop. With 32 places a new connection then
/// has 160 ms to send its greeting.
constexpr auto kCrowded = std::chrono::milliseconds(5);
// Period of the checks for silent and slow connections.
constexpr auto kWatchEvery = std::chrono::seconds(1);
/// A connection silent for less than this is in use: masters, workers and clients send every second, and one
/// message may be delayed.
constexpr auto kSilent = std::chrono::seconds(3);

class TcpListener final : public Listener {
 public:
  TcpListener(asio::io_context& io, std::unique_ptr<Acceptor> acceptor, Security security,
              OnConnection on_connection, ListenerOptions options)
      : io_(io),
        acceptor_(std::move(acceptor)),
        watch_(io),
        security_(std::move(security)),
        on_connection_(std::move(on_connection)),
        options_(std::move(options)),
        budget_(std::make_shared<IncomingBudget>(options_.incoming_bytes)) {
    acceptor_->Start({[this](int socket) { return Take(socket); },
                      [this](const std::string& reason) { OnNoFiles(reason); }});
    Watch();
  }
  ~TcpListener() override { *alive_ = false; }
  uint16_t port() const override { return acceptor_->port(); }

 private:
  using ConnectionPtr = std::shared_ptr<AcceptedConnection>;

  std::chrono::milliseconds Take(int socket) {
    const bool crowded = MakeRoom();
    auto connection = MakeConnection(io_, socket, security_, {}, budget_);
    connections_.push_back(connection);
    const OnConnection on_connection = on_connection_;  // which may destroy this listener
    on_connection(connection);
    // The new connection needs a moment to greet before further ones take its place.
    return crowded ? kCrowded : std::chrono::milliseconds(0);
  }

  /// Drops an idle connection when the process can open no more files.
  void OnNoFiles(const std::string& reason) {
    SayOnce(fmt::format("cannot accept a connection: {}; drops idle ones (`ulimit -n` raises the limit)",
                        reason));
    Forget();
    if (const ConnectionPtr idle = MostIdle())
      idle->Drop("is dropped: this process can open no more files", false);
  }

  void Watch() {
    const auto now = AcceptedConnection::Clock::now();
    Forget();
    for (const auto& weak : std::vector(connections_.begin(), connections_.end()))
      if (const ConnectionPtr connection = weak.lock()) connection->Watch(now);
    watch_.expires_after(kWatchEvery);
    watch_.async_wait([this, alive = alive_](const ErrorCode& e) {
      if (!e && *alive) Watch();
    });
  }

  /// Removes closed connections, which hold no descriptor any more.
  void Forget() {
    std::erase_if(connections_, [](const std::weak_ptr<AcceptedConnection>& weak) {
      const ConnectionPtr connection = weak.lock();
      return !connection || connection->closed();
    });
  }

  /// Makes room for one more connection. Returns: whether another connection was dropped for it.
  bool MakeRoom() {
    Forget();
    const size_t before = connections_.size();
    size_t newcomers = 0;
    for (const auto& weak : connections_) newcomers += weak.lock()->newcomer();
    if (newcomers >= kMaxNewcomers)
      MostIdle()->Drop(fmt::format("is dropped: {} other connections have sent no greeting", kMaxNewcomers),
                       false);
    Forget();
    if (connections_.size() < options_.most_connections) return connections_.size() < before;
    SayOnce(fmt::format("has {} connections, its limit; idle ones are dropped for new ones",
                        options_.most_connections));
    if (const ConnectionPtr idle = MostIdle())
      idle->Drop(fmt::format("is dropped: {} others are connected", options_.most_connections), false);
    return true;
  }

  /// The connection that costs least to drop. First the oldest without a greeting, then the longest silent of
  /// the connections that fetch blocks, then the longest silent of all if it is silent for kSilent. May be
  /// null.
  ConnectionPtr MostIdle() const {
    ConnectionPtr fetches, silent;
    const auto longer = [](const ConnectionPtr& a, const ConnectionPtr& b) {
      return !b || a->heard() < b->heard();
    };
    for (const auto& weak : connections_) {
      ConnectionPtr c = weak.lock();
      if (c->newcomer()) return c;
      if (c->fetches() && longer(c, fetches)) fetches = c;
      if (longer(c, silent)) silent = c;
    }
    if (fetches) return fetches;
    if (silent && AcceptedConnection::Clock::now() - silent->heard() < kSilent) return nullptr;
    return silent;
  }

  void SayOnce(const std::string& line) {
    if (options_.log && !std::exchange(said_, true)) options_.log(line);
  }

  asio::io_context& io_;
  const std::unique_ptr<Acceptor> acceptor_;
  asio::steady_timer watch_;
  Security security_;
  OnConnection on_connection_;
  const ListenerOptions options_;
  const std::shared_ptr<IncomingBudget> budget_;
  std::deque<std::weak_ptr<AcceptedConnection>> connections_;         ///< open connections, oldest first
  bool said_ = false;                                                 ///< whether the log has named the limit
  const std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< false once this is destroyed
};

/// An attempt to connect and its time limit.
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
  const std::string name = TextOf(endpoint);
  // Without it the system's own limit applies, which is minutes.
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
      return done(MakeConnection(io, attempt->socket.release(), security, host, nullptr));
    std::string why = attempt->timed_out ? "no answer" : error.message();
    if (error == asio::error::connection_refused) why += "; no program listens there";
    done(Fail(fmt::format("cannot reach {}: {}", name, why)));
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
                                                 const Security& security, OnConnection on_connection,
                                                 ListenerOptions options) {
  constexpr std::string_view kAdvice =
      "give --secret-file F, the same on every machine ('openssl rand -hex 32' makes a secret), or "
      "--tls-cert, "
      "--tls-key and --tls-ca";
  QUARRY_ASSIGN(std::unique_ptr<Acceptor> acceptor, Acceptor::Open(io, endpoint, security.tls(), kAdvice));
  const size_t most = std::max<uint64_t>(8, DescriptorLimit() / 2);
  options.most_connections = options.most_connections == 0 ? most : std::min(most, options.most_connections);
  return std::make_unique<TcpListener>(io, std::move(acceptor), security, std::move(on_connection),
                                       std::move(options));
}

}  // namespace quarry

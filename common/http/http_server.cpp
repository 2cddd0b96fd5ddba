#include "common/http/http_server.h"

#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <utility>

#include "common/base/resource.h"
#include "common/http/http_connection.h"
#include "common/net/security.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

/// Pause before the next accept when the process can open no more files. Trades a core spent on failing
/// accepts against the delay of a new connection. The same as of the listener for workers.
constexpr auto kNoFiles = std::chrono::milliseconds(100);

class TcpHttpServer final : public HttpServer {
 public:
  TcpHttpServer(asio::io_context& io, tcp::acceptor acceptor, std::shared_ptr<HttpService> service)
      : io_(io), acceptor_(std::move(acceptor)), pause_(io), service_(std::move(service)) {
    Accept();
  }
  ~TcpHttpServer() override {
    service_->stopped = true;
    service_->handlers = {};
    service_->options.log = nullptr;
    for (const auto& weak : std::exchange(service_->connections, {}))
      if (const auto connection = weak.lock()) connection->Drop();
  }
  uint16_t port() const override {
    ErrorCode ignored;
    return acceptor_.local_endpoint(ignored).port();
  }

 private:
  void Accept() {
    acceptor_.async_accept([this, service = service_](const ErrorCode& error, tcp::socket socket) {
      // A connection that is already accepted comes even after the acceptor is destroyed.
      if (service->stopped || error == asio::error::operation_aborted) return;
      if (error) return AcceptLater(error);
      if (MakeRoom()) ServeConnection(io_, socket.release(), service_);
      Accept();
    });
  }

  /// Handles a failed accept, such as too many open files: closes an idle connection and tries again later.
  void AcceptLater(const ErrorCode& error) {
    SayOnce(fmt::format("cannot accept a connection: {}; closes idle ones (`ulimit -n` raises the limit)",
                        error.message()));
    DropIdle();
    pause_.expires_after(kNoFiles);
    pause_.async_wait([this, service = service_](const ErrorCode& e) {
      if (!e && !service->stopped) Accept();
    });
  }

  /// Makes room for one more connection. Returns: whether there is any.
  bool MakeRoom() {
    std::erase_if(service_->connections, [](const std::weak_ptr<ServedConnection>& weak) {
      const auto connection = weak.lock();
      return !connection || connection->closed();
    });
    const size_t most = service_->options.most_connections;
    if (service_->connections.size() < most) return true;
    SayOnce(fmt::format("has {} connections, as many as it takes; closes idle ones for others", most));
    return DropIdle();
  }

  /// Drops the connection without a WebSocket that has been idle for longest. Returns: whether there was one.
  bool DropIdle() {
    std::shared_ptr<ServedConnection> idle;
    for (const auto& weak : service_->connections) {
      const auto connection = weak.lock();
      if (!connection || connection->closed() || connection->web_socket()) continue;
      if (!idle || connection->active() < idle->active()) idle = connection;
    }
    if (idle) idle->Drop();
    return idle != nullptr;
  }

  void SayOnce(const std::string& line) {
    if (service_->options.log && !std::exchange(said_, true)) service_->options.log(line);
  }

  asio::io_context& io_;
  tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  const std::shared_ptr<HttpService> service_;
  bool said_ = false;  ///< whether the log has told of the limit
};

/// The TLS context of a server for browsers; null without files.
Result<std::shared_ptr<ssl_ctx_st>> MakeTls(const TlsFiles& files) {
  if (files.cert.empty() != files.key.empty())
    return BadUsage("--tls-cert and --tls-key go together: a certificate and its private key");
  if (files.cert.empty()) return nullptr;
  std::shared_ptr<ssl_ctx_st> context(SSL_CTX_new(TLS_server_method()), SSL_CTX_free);
  if (!context) return Fail("OpenSSL cannot be used: it makes no context");
  SSL_CTX_set_min_proto_version(context.get(), TLS1_2_VERSION);
  SSL_CTX_set_options(context.get(), SSL_OP_NO_RENEGOTIATION);
  QUARRY_TRY(UseCertificate(context.get(), files.cert, files.key));
  return context;
}

Result<tcp::acceptor> Listen(asio::io_context& io, const Endpoint& endpoint, bool tls) {
  const std::string name =
      fmt::format(fmt::runtime(endpoint.host.find(':') == std::string::npos ? "{}:{}" : "[{}]:{}"),
                  endpoint.host, endpoint.port);
  ErrorCode error;
  const auto found = tcp::resolver(io).resolve(endpoint.host, std::to_string(endpoint.port), error);
  if (error || found.empty()) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  const tcp::endpoint address = found.begin()->endpoint();
  if (!tls && !address.address().is_loopback())
    return BadUsage(
        fmt::format("will not serve pages at {}, which is not a loopback address, without encryption; give "
                    "--tls-cert and "
                    "--tls-key, or listen at 127.0.0.1 and come through ssh -L",
                    name));
  tcp::acceptor acceptor(io);
  acceptor.open(address.protocol(), error);
  if (!error) acceptor.set_option(tcp::acceptor::reuse_address(true), error);
  if (!error) acceptor.bind(address, error);
  if (!error) acceptor.listen(asio::socket_base::max_listen_connections, error);
  if (error == asio::error::address_in_use)
    return Fail(
        fmt::format("cannot listen at {}: the address is in use by another program; give another port, or 0 "
                    "for a free one",
                    name));
  if (error) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  return acceptor;
}

}  // namespace

Result<std::unique_ptr<HttpServer>> HttpServer::Open(asio::io_context& io, HttpServerOptions options,
                                                     Handlers handlers) {
  QUARRY_ASSIGN(std::shared_ptr<ssl_ctx_st> tls, MakeTls(options.tls));
  QUARRY_ASSIGN(tcp::acceptor acceptor, Listen(io, options.listen, tls != nullptr));
  const size_t most = std::max<uint64_t>(8, DescriptorLimit() / 4);
  options.most_connections = std::min(most, options.most_connections);
  auto service = std::make_shared<HttpService>(
      HttpService{std::move(options), std::move(handlers), std::move(tls), {}, false});
  return std::make_unique<TcpHttpServer>(io, std::move(acceptor), std::move(service));
}

}  // namespace quarry

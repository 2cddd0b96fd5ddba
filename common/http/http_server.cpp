#include "common/http/http_server.h"

#include <fmt/format.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <unistd.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <chrono>
#include <string_view>
#include <utility>

#include "common/base/resource.h"
#include "common/http/http_connection.h"
#include "common/net/acceptor.h"
#include "common/net/security.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

class TcpHttpServer final : public HttpServer {
 public:
  TcpHttpServer(asio::io_context& io, std::unique_ptr<Acceptor> acceptor,
                std::shared_ptr<HttpService> service)
      : io_(io), acceptor_(std::move(acceptor)), service_(std::move(service)) {
    acceptor_->Start({[this](int socket) { return Take(socket); },
                      [this](const std::string& reason) { OnNoFiles(reason); }});
  }
  ~TcpHttpServer() override {
    service_->stopped = true;
    service_->handlers = {};
    service_->options.log = nullptr;
    for (const auto& weak : std::exchange(service_->connections, {}))
      if (const auto connection = weak.lock()) connection->Drop();
  }
  uint16_t port() const override { return acceptor_->port(); }

 private:
  std::chrono::milliseconds Take(int socket) {
    if (MakeRoom())
      ServeConnection(io_, socket, service_);
    else
      ::close(socket);
    return std::chrono::milliseconds(0);
  }

  /// Closes an idle connection when the process can open no more files.
  void OnNoFiles(const std::string& reason) {
    SayOnce(fmt::format("cannot accept a connection: {}; closes idle ones (`ulimit -n` raises the limit)",
                        reason));
    DropIdle();
  }

  /// Makes room for one more connection. Returns: whether there is any.
  bool MakeRoom() {
    std::erase_if(service_->connections, [](const std::weak_ptr<ServedConnection>& weak) {
      const auto connection = weak.lock();
      return !connection || connection->closed();
    });
    const size_t most = service_->options.most_connections;
    if (service_->connections.size() < most) return true;
    SayOnce(fmt::format("has {} connections, its limit; idle ones are closed for new ones", most));
    return DropIdle();
  }

  /// Drops the longest idle connection without a WebSocket. Returns: whether there was one.
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
  const std::unique_ptr<Acceptor> acceptor_;
  const std::shared_ptr<HttpService> service_;
  bool said_ = false;  ///< whether the log has named the limit
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

}  // namespace

Result<std::unique_ptr<HttpServer>> HttpServer::Open(asio::io_context& io, HttpServerOptions options,
                                                     Handlers handlers) {
  QUARRY_ASSIGN(std::shared_ptr<ssl_ctx_st> tls, MakeTls(options.tls));
  constexpr std::string_view kAdvice =
      "give --tls-cert and --tls-key, or listen at 127.0.0.1 and come through ssh -L";
  QUARRY_ASSIGN(std::unique_ptr<Acceptor> acceptor,
                Acceptor::Open(io, options.listen, tls != nullptr, kAdvice));
  const size_t most = std::max<uint64_t>(8, DescriptorLimit() / 4);
  options.most_connections = std::min(most, options.most_connections);
  auto service = std::make_shared<HttpService>(
      HttpService{std::move(options), std::move(handlers), std::move(tls), {}, false});
  return std::make_unique<TcpHttpServer>(io, std::move(acceptor), std::move(service));
}

}  // namespace quarry

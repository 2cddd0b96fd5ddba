#include "common/net/acceptor.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <utility>

namespace quarry {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using ErrorCode = boost::system::error_code;

/// Pause before the next accept when the process can open no more files. Trades a core spent on failing
/// accepts against the delay of a new connection. A judgement: ten accepts a second cost nothing, and a peer
/// waits 10 s for its connection.
constexpr std::chrono::milliseconds kNoFiles{100};

class TcpAcceptor final : public Acceptor {
 public:
  explicit TcpAcceptor(tcp::acceptor acceptor)
      : acceptor_(std::move(acceptor)), pause_(acceptor_.get_executor()) {}
  ~TcpAcceptor() override { *alive_ = false; }

  void Start(Handlers handlers) override {
    handlers_ = std::move(handlers);
    Accept();
  }
  uint16_t port() const override {
    ErrorCode ignored;
    return acceptor_.local_endpoint(ignored).port();
  }

 private:
  void Accept() {
    // A connection that came before the acceptor was destroyed is reported after it, without an error.
    acceptor_.async_accept([this, alive = alive_](const ErrorCode& error, tcp::socket socket) {
      if (!*alive || error == asio::error::operation_aborted) return;
      std::chrono::milliseconds pause = kNoFiles;
      if (error) {
        handlers_.on_failure(error.message());
      } else {
        const auto on_socket = handlers_.on_socket;  // which may destroy this
        pause = on_socket(socket.release());
      }
      if (!*alive) return;
      if (pause.count() == 0) return Accept();
      AcceptAfter(pause);
    });
  }

  void AcceptAfter(std::chrono::milliseconds pause) {
    pause_.expires_after(pause);
    pause_.async_wait([this, alive = alive_](const ErrorCode& e) {
      if (!e && *alive) Accept();
    });
  }

  tcp::acceptor acceptor_;
  asio::steady_timer pause_;
  Handlers handlers_;
  const std::shared_ptr<bool> alive_ = std::make_shared<bool>(true);  ///< false once this is destroyed
};

}  // namespace

Result<std::unique_ptr<Acceptor>> Acceptor::Open(asio::io_context& io, const Endpoint& endpoint,
                                                 bool encrypted, std::string_view advice) {
  const std::string name = TextOf(endpoint);
  ErrorCode error;
  const auto found = tcp::resolver(io).resolve(endpoint.host, std::to_string(endpoint.port), error);
  if (error || found.empty()) return Fail(fmt::format("cannot listen at {}: {}", name, error.message()));
  const tcp::endpoint address = found.begin()->endpoint();
  if (!encrypted && !address.address().is_loopback())
    return BadUsage(fmt::format(
        "will not listen at {}, which is not a loopback address, without encryption; {}", name, advice));
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
  return std::make_unique<TcpAcceptor>(std::move(acceptor));
}

}  // namespace quarry

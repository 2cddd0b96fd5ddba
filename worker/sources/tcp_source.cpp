#include "worker/sources/tcp_source.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <deque>
#include <unordered_map>
#include <utility>

#include "common/protocol/messages.h"

namespace quarry {

struct TcpVoxelSource::Impl : std::enable_shared_from_this<TcpVoxelSource::Impl> {
  struct Waiting {
    BlockKey block;
    Done done;
  };
  Impl(boost::asio::io_context& context, Endpoint e, Security s, const Catalog& c)
      : io(context), server(std::move(e)), security(std::move(s)), catalog(c), watch(context) {}

  void Reach() {
    reaching = true;
    Connect(io, server, security, [self = shared_from_this()](Result<std::shared_ptr<Connection>> result) {
      self->reaching = false;
      if (self->stopped) return;
      if (!result) return self->Lost(result.error());
      self->connection = *result;
      self->connection->Expect(Speaker::kVoxelServer, self->catalog.meta.largest_stored);
      self->connection->Start([self](Message m) { self->OnMessage(std::move(m)); },
                              [self](const Error& e) { self->Lost(e); });
      self->connection->Send(MakeMessage(
          MessageType::kHello, Hello{.role = Role::kVoxels, .name = "voxels", .store = self->catalog.id}));
      self->Watch(0);
    });
  }

  /// Checks every kStallS whether any byte has come.
  void Watch(uint64_t received_before) {
    watch.expires_after(
        std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(kStallS)));
    watch.async_wait([self = shared_from_this(), received_before](const boost::system::error_code& e) {
      if (e || self->stopped || !self->connection) return;
      const uint64_t received = self->connection->received_bytes();
      if (received == received_before && !self->waiting.empty() && self->owes)
        return self->Lost(
            Error{fmt::format("{}:{} has stopped answering", self->server.host, self->server.port)});
      self->owes = !self->waiting.empty();
      self->connection->Send({MessageType::kPing, 0, {}, {}});
      self->Watch(received);
    });
  }

  void Lost(const Error& error) {
    if (stopped) return;
    if (connection) connection->Close();
    connection.reset();
    ready = owes = false;
    asked = 0;
    unasked.clear();
    watch.cancel();
    // No error on the way to a server is permanent for a block: flipped bits in a handshake look like another
    // secret, and a server may be replaced.
    for (auto& [request, w] : std::exchange(waiting, {})) w.done(tl::unexpected<Error>(Error{error.message}));
  }

  void OnMessage(Message m) {
    if (stopped || !connection || m.type == MessageType::kPing) return;
    if (m.type == MessageType::kWelcome) return OnWelcome(m);
    const auto it = waiting.find(m.request);
    if (it == waiting.end() || (!unasked.empty() && m.request >= unasked.front())) {
      const auto failure = DecodeFailure(m.table);
      if (m.type == MessageType::kFailure && failure) Lost(Error{failure->message});
      return;
    }
    Done done = std::move(it->second.done);
    waiting.erase(it);
    --asked;
    AskMore();
    if (m.type == MessageType::kBlock) return done(std::move(m.raw));
    const auto failure = DecodeFailure(m.table);
    done(tl::unexpected<Error>(Error{failure ? failure->message : "the voxel server gave an invalid answer",
                                     ErrorKind::kPermanent}));
  }

  void OnWelcome(const Message& m) {
    const auto welcome = DecodeWelcome(m.table);
    if (!welcome || welcome->scene_id != catalog.id)
      return Lost(Error{fmt::format("{}:{} serves another scene", server.host, server.port)});
    ready = true;
    AskMore();
  }

  /// Sends requests, oldest first, up to the number allowed at once.
  void AskMore() {
    for (; asked < kMostBlockRequests && !unasked.empty(); unasked.pop_front()) {
      const uint64_t request = unasked.front();
      ++asked;
      const uint32_t block = catalog.NumberOf(waiting.at(request).block);
      connection->Send(MakeMessage(MessageType::kBlockRequest, BlockRequest{block}, request));
    }
  }

  boost::asio::io_context& io;
  Endpoint server;
  Security security;
  const Catalog& catalog;
  boost::asio::steady_timer watch;
  std::shared_ptr<Connection> connection;
  std::unordered_map<uint64_t, Waiting> waiting;  ///< by request id
  std::deque<uint64_t> unasked;                   ///< the ids in `waiting` not yet sent, ascending
  uint32_t asked = 0;                             ///< requests sent and not answered
  uint64_t next_request = 1;
  bool reaching = false, ready = false, stopped = false;
  bool owes = false;  ///< answers were outstanding at the last check
};

TcpVoxelSource::TcpVoxelSource(boost::asio::io_context& io, Endpoint server, Security security,
                               const Catalog& catalog)
    : impl_(std::make_shared<Impl>(io, std::move(server), std::move(security), catalog)) {}

TcpVoxelSource::~TcpVoxelSource() {
  impl_->stopped = true;
  impl_->watch.cancel();
  impl_->waiting.clear();
  if (impl_->connection) impl_->connection->Close();
}

void TcpVoxelSource::Fetch(BlockKey block, Done done) {
  const uint64_t request = impl_->next_request++;
  impl_->waiting.emplace(request, Impl::Waiting{block, std::move(done)});
  impl_->unasked.push_back(request);
  if (impl_->ready) return impl_->AskMore();
  if (!impl_->connection && !impl_->reaching) impl_->Reach();
}

}  // namespace quarry

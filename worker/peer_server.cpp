#include "worker/peer_server.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "common/base/resource.h"
#include "common/protocol/messages.h"

namespace quarry {

Status PeerServer::Listen(boost::asio::io_context& io, const Endpoint& endpoint, const Security& security) {
  // Requests are small. The worker's own connections and files need descriptors too.
  ListenerOptions options;
  options.incoming_bytes = 256u << 10;
  options.most_connections = std::min<size_t>(kMostConnections, DescriptorLimit() / 4);
  QUARRY_ASSIGN(listener_,
                Listener::Open(
                    io, endpoint, security, [this](std::shared_ptr<Connection> c) { OnConnection(c); },
                    std::move(options)));
  return {};
}

PeerServer::~PeerServer() {
  for (const auto& c : newcomers_) c->Close();
  for (const auto& c : peers_) c->Close();
}

void PeerServer::OnConnection(const std::shared_ptr<Connection>& c) {
  newcomers_.insert(c);
  c->Start([this, c](const Message& m) { OnMessage(c, m); },
           [this, c](const Error&) {
             newcomers_.erase(c);
             peers_.erase(c);
           });
}

void PeerServer::OnMessage(const std::shared_ptr<Connection>& c, const Message& m) {
  if (newcomers_.contains(c)) {
    const auto hello = DecodeHello(m.table);
    if (m.type != MessageType::kHello || !hello || hello->role != Role::kVoxels) return Drop(c);
    newcomers_.erase(c);
    peers_.insert(c);
    c->Expect(Speaker::kVoxels);
    return c->Send(MakeMessage(MessageType::kWelcome, Welcome{catalog_.id, 0, {}}));
  }
  if (m.type == MessageType::kPing) return;
  const auto request = DecodeBlockRequest(m.table);
  if (m.type != MessageType::kBlockRequest || !request || c->queued_bytes() > 2 * kMaxQueuedBytes)
    return Drop(c);
  if (QueuedBytes() >= kMaxQueuedBytes) DropStalled();
  if (!peers_.contains(c)) return;
  const std::optional<BlockKey> block = catalog_.BlockOf(request->block);
  const Bytes* bytes = block && QueuedBytes() < kMaxQueuedBytes ? blocks_.Find(*block) : nullptr;
  if (bytes) {
    bytes_served_ += bytes->size();
    return c->Send({MessageType::kBlock, m.request, {}, *bytes});
  }
  c->Send(MakeMessage(MessageType::kFailure, Failure{"this worker does not have the block, or is too busy"},
                      m.request));
}

uint64_t PeerServer::QueuedBytes() const {
  uint64_t bytes = 0;
  for (const auto& c : peers_) bytes += c->queued_bytes();
  return bytes;
}

/// Drops peers that do not read, since their queued blocks hold up others.
void PeerServer::DropStalled() {
  constexpr double kMostUnreadS = 2;
  for (const auto& c : std::vector(peers_.begin(), peers_.end()))
    if (c->unread_s() > kMostUnreadS) Drop(c);
}

void PeerServer::Drop(const std::shared_ptr<Connection>& c) {
  newcomers_.erase(c);
  peers_.erase(c);
  c->Close();
}

}  // namespace quarry

#pragma once

#include <memory>
#include <set>

#include "common/net/connection.h"
#include "common/voxel/catalog.h"
#include "worker/sources/stored_cache.h"

namespace quarry {

/// Serves other workers the stored blocks that this one has: the voxel half of the protocol, without a disk.
/// A block that is not here is refused at once. Used from the io_context's thread.
class PeerServer {
 public:
  /// And no more than a quarter of the descriptors that the process may open.
  static constexpr size_t kMostConnections = 256;
  /// To all together: beyond this blocks are refused, and whoever has not read for 2 s is dropped.
  static constexpr uint64_t kMaxQueuedBytes = 8u << 20;

  PeerServer(const SceneId& scene, StoredCache& blocks) : scene_(scene), blocks_(blocks) {}
  /// Errors: as Listener::Open's.
  Status Listen(boost::asio::io_context& io, const Endpoint& endpoint, const Security& security);
  uint16_t port() const { return listener_ ? listener_->port() : 0; }
  uint64_t bytes_served() const { return bytes_served_; }
  ~PeerServer();

 private:
  void OnConnection(const std::shared_ptr<Connection>& c);
  void OnMessage(const std::shared_ptr<Connection>& c, const Message& m);
  void DropStalled();
  void Drop(const std::shared_ptr<Connection>& c);
  uint64_t QueuedBytes() const;

  const SceneId scene_;
  StoredCache& blocks_;
  std::unique_ptr<Listener> listener_;
  std::set<std::shared_ptr<Connection>> newcomers_, peers_;
  uint64_t bytes_served_ = 0;
};

}  // namespace quarry

#pragma once

#include <memory>
#include <set>

#include "common/net/connection.h"
#include "common/voxel/catalog.h"
#include "worker/sources/stored_cache.h"

namespace quarry {

/// Serves this worker's stored blocks to other workers: the voxel part of the protocol, without a disk. A
/// request for a block that is not in the cache is refused at once. Used from the io_context's thread.
class PeerServer {
 public:
  /// Limit of connections; the quarter of the descriptors that the process may open also limits them.
  static constexpr size_t kMostConnections = 256;
  /// Limit of queued bytes over all peers. At the limit blocks are refused, and peers that have read nothing
  /// for 2 s are dropped.
  static constexpr uint64_t kMaxQueuedBytes = 8u << 20;

  /// Requires: `catalog` and `blocks` outlive this.
  PeerServer(const Catalog& catalog, StoredCache& blocks) : catalog_(catalog), blocks_(blocks) {}
  /// Errors: as Listener::Open().
  Status Listen(boost::asio::io_context& io, const Endpoint& endpoint, const Security& security);
  /// The port in use, or 0 before Listen().
  uint16_t port() const { return listener_ ? listener_->port() : 0; }
  /// Bytes of blocks sent to other workers.
  uint64_t bytes_served() const { return bytes_served_; }
  ~PeerServer();

 private:
  void OnConnection(const std::shared_ptr<Connection>& c);
  void OnMessage(const std::shared_ptr<Connection>& c, const Message& m);
  void DropStalled();
  void Drop(const std::shared_ptr<Connection>& c);
  uint64_t QueuedBytes() const;

  const Catalog& catalog_;
  StoredCache& blocks_;
  std::unique_ptr<Listener> listener_;
  std::set<std::shared_ptr<Connection>> newcomers_, peers_;
  uint64_t bytes_served_ = 0;
};

}  // namespace quarry

#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/remote/http_options.h"
#include "worker/peer_server.h"
#include "worker/sources/disk_cache.h"
#include "worker/sources/source_set.h"
#include "worker/sources/stored_cache.h"

namespace quarry {

/// Settings of a BlockSupply. Units: names end in bytes and seconds.
struct SupplyOptions {
  Endpoint master;
  Security security, serving;        ///< toward masters and servers; toward workers that connect
  std::vector<std::string> sources;  ///< as ParseSource() reads them
  bool own_sources = false;          ///< the command line names the sources, not the master
  uint64_t stored_bytes = 0;         ///< budget of the StoredCache
  std::optional<DiskCacheLocation> disk_cache;
  HttpOptions http;
  std::vector<HttpAuthority> header_servers;  ///< servers that get headers even if only the master names them
  double give_up_after_s = 60;
  std::function<void(const std::string&)> log;
  std::function<bool()> idle;  ///< whether no ray waits for a block on its way
};

/// Supplies a worker's blocks from its cache of stored blocks, its disk, other workers and the scene's
/// sources, and serves stored blocks to other workers. Used from the io_context's thread.
class BlockSupply {
 public:
  /// Requires: `io`, `catalog` and `inventory` outlive it. Errors: a source that cannot be used (a file of
  /// another scene, an invalid address).
  static Result<std::unique_ptr<BlockSupply>> Open(boost::asio::io_context& io, const Catalog& catalog,
                                                   const SupplyOptions& options, CacheInventory& inventory);

  /// The source that the engine fetches blocks from.
  VoxelSource& source() { return stored_; }
  /// Starts to serve other workers. Errors: as Listener::Open().
  Status Serve(const Endpoint& endpoint) { return server_.Listen(io_, endpoint, serving_); }
  /// The port of Serve(), or 0.
  uint16_t serves_at() const { return server_.port(); }

  /// Replaces the set of other workers to ask.
  void SetPeers(const Peers& peers);
  /// Notes the blocks that a tile is expected to need, and the workers that hold them.
  void Expect(const TileOrder& order);
  /// Fetches expected blocks while the link is idle.
  void Prefetch();
  /// Forgets the expected blocks.
  void ClearExpected() { expected_.clear(); }

  const SourceSet::Counters& counters() const { return sources_.counters(); }
  uint64_t bytes_from_disk() const { return disk_ ? disk_->counters().bytes_read : 0; }
  StoredCache::Counters stored() const { return stored_.counters(); }

 private:
  /// Expected blocks remembered; the limit bounds their list to 128 KiB. Prefetches at once: trades hidden
  /// latency against a link that is busy when a ray needs a block. Both are judgements: 16,384 blocks exceed
  /// most caches, and four blocks of 256 KiB delay a ray's block by 8 ms on a link of 1 Gbit/s.
  static constexpr size_t kMostExpected = 1u << 14, kMostPrefetching = 4;
  BlockSupply(boost::asio::io_context& io, const Catalog& catalog, const SupplyOptions& options,
              CacheInventory& inventory);
  Status Add(const std::string& text, const SupplyOptions& options);
  HttpOptions HttpFor(const HttpLocation& location, const SupplyOptions& options) const;

  boost::asio::io_context& io_;
  const Catalog& catalog_;
  CacheInventory& inventory_;
  std::function<bool()> idle_;
  const Security security_, serving_;
  SourceSet sources_;
  std::unique_ptr<DiskCachedSource> disk_;  ///< in front of `sources_`, or null
  StoredCache stored_;
  PeerServer server_;
  std::deque<BlockKey> expected_;
};

}  // namespace quarry

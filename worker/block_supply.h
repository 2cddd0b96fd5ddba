#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "worker/peer_server.h"
#include "worker/sources/disk_cache.h"
#include "worker/sources/http_options.h"
#include "worker/sources/source_set.h"
#include "worker/sources/stored_cache.h"

namespace quarry {

struct SupplyOptions {
  Endpoint master;
  Security security, serving;        ///< toward masters and servers; toward workers that ask
  std::vector<std::string> sources;  ///< as ParseSource has them
  bool own_sources = false;          ///< this worker's command line names them, not the master
  uint64_t stored_bytes = 0;         ///< of the StoredCache
  std::optional<DiskCacheLocation> disk_cache;
  HttpOptions http;
  std::vector<HttpServer> header_servers;  ///< that get its headers though only the master names them
  double give_up_after_s = 60;
  std::function<void(const std::string&)> log;
  std::function<bool()> idle;  ///< whether no ray waits for a block on its way
};

/// Where a worker's blocks come from: its stored ones, its disk, other workers, the scene's sources; and what
/// it gives to other workers. Used from the io_context's thread.
class BlockSupply {
 public:
  /// Errors: a source that cannot be (a file that is not the scene, an address that is none).
  static Result<std::unique_ptr<BlockSupply>> Open(boost::asio::io_context& io, const Catalog& catalog,
                                                   const SupplyOptions& options, CacheInventory& inventory);

  VoxelSource& source() { return stored_; }
  /// Serves other workers from now on. Errors: as Listener::Open's.
  Status Serve(const Endpoint& endpoint) { return server_.Listen(io_, endpoint, serving_); }
  uint16_t serves_at() const { return server_.port(); }

  void SetPeers(const Peers& peers);
  /// What a tile is expected to need.
  void Expect(const TileOrder& order);
  /// While the link is idle, fetches what is expected to be needed.
  void Prefetch();
  /// Forgets what was expected.
  void ClearExpected() { expected_.clear(); }

  const SourceSet::Counters& counters() const { return sources_.counters(); }
  uint64_t bytes_from_disk() const { return disk_ ? disk_->counters().bytes_read : 0; }
  StoredCache::Counters stored() const { return stored_.counters(); }

 private:
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
  std::unique_ptr<DiskCachedSource> disk_;  ///< in front of them, or null
  StoredCache stored_;
  PeerServer server_;
  std::deque<BlockKey> expected_;
};

}  // namespace quarry

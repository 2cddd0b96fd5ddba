#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/engine/adaptive_queue_depth.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "master/schedule/conduct.h"
#include "master/schedule/scheduler.h"

namespace quarry {

/// A worker as the master knows it.
struct WorkerRecord {
  std::shared_ptr<Connection> connection;
  uint32_t id = 0;
  uint64_t instance = 0;  ///< its own number, the same after a loss of the connection
  std::string name;
  uint32_t threads = 1;
  std::string serves_at;  ///< HOST:PORT, or empty
  WorkerStatus counters;
  BlockSet holds;
  std::set<uint64_t> setups;  ///< frames it was told of
  uint32_t tiles = 0;         ///< done
  bool has_catalog = false;   ///< the scene has been sent to it: it can be given tiles
  bool has_scene = false;     ///< it has said so: it can be told of other workers
  Conduct conduct;

  void SetServesAt(uint16_t port);  ///< 0: it does not serve others

  /// Tiles it may have at once: as many as it wants, but few while it has answered none, and one while it is
  /// doubtful that it answers.
  uint32_t Credit() const {
    constexpr uint32_t kUnprovenThreads = 64;
    if (conduct.doubtful()) return 1;
    if (tiles == 0) return FewestTiles(std::min(threads, kUnprovenThreads));
    return std::clamp(counters.tiles_wanted, FewestTiles(threads), MostTilesIfScarce(threads));
  }
};

/// The workers that are here. One that comes back after a loss keeps its id. Not thread-safe.
class WorkerRegistry {
 public:
  /// Requires: the connection is not in it. A connection of the same instance is to be dropped by the caller
  /// first.
  WorkerRecord& Add(const std::shared_ptr<Connection>& connection, const Hello& hello);
  void Remove(const Connection* connection);
  WorkerRecord* Find(const Connection* connection);
  WorkerRecord* FindById(uint32_t id);
  /// The one of this instance, if it is here.
  WorkerRecord* FindInstance(uint64_t instance);
  const std::map<uint32_t, WorkerRecord>& all() const { return workers_; }
  std::map<uint32_t, WorkerRecord>& all() { return workers_; }

  /// Whether anybody here has answered a tile and goes on answering.
  bool AnyProven() const;
  /// Takes up counters and what has changed in the cache.
  static void Update(WorkerRecord& worker, const WorkerStatus& alive);
  /// Which workers serve others, and where.
  Peers MakePeers() const;
  /// Seconds that a stored byte of voxels takes a worker to fetch and to decode, measured over all; while not
  /// known, 100 Mbit/s and nothing. `decoded`: bytes that a stored byte becomes. What comes once may be
  /// decoded again and again, so each is measured by its own bytes.
  double SecondsPerByte(double decoded) const;
  /// Of all that are here, since each began.
  double DecodeSeconds() const;
  /// A worker other than `but` that holds the block and serves it, or 0; another one for another block.
  uint32_t HolderOf(uint32_t block, uint32_t but) const;

 private:
  std::map<uint32_t, WorkerRecord> workers_;  ///< by id
  std::map<const Connection*, uint32_t> ids_;
  std::map<uint64_t, uint32_t> known_;  ///< instance to id, also of those that have gone
  uint32_t next_id_ = 1;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "common/engine/adaptive_queue_depth.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "master/environments.h"
#include "master/schedule/dispatcher.h"

namespace quarry {

/// A worker as the master knows it: the dispatcher's part, and its connection.
struct WorkerRecord : WorkerState {
  std::shared_ptr<Connection> connection;
  uint64_t instance = 0;  ///< the worker's own number, the same after it has lost its connection
  std::string name;
  std::string serves_at;  ///< HOST:PORT where other workers get blocks from it; empty: nowhere
  WorkerStatus counters;  ///< without lists of blocks
  std::set<FrameId> frames_told;
  std::deque<uint64_t> selections_told;  ///< the newest kMostSelections, which it keeps
  std::set<SceneId> environments_told;
  const Environments* environments = nullptr;  ///< null: there are none
  bool has_scene = false;  ///< it has confirmed the catalog, so it can get the list of other workers

  /// `port`: at the connection's host; 0: it serves no blocks.
  void SetServesAt(uint16_t port);
  /// Sends a view's selection, unless the worker has it. Call before a message that names the selection.
  void TellSelection(const ViewParts& parts);
  /// The same, and the view's environment.
  void TellNeedsOf(const View& view);
};

/// The connected workers. A worker that comes back after it has lost its connection keeps its id.
/// Units: seconds, stored bytes. Not thread-safe.
class WorkerRegistry {
 public:
  /// `environments` outlive this; null: there are none.
  explicit WorkerRegistry(const Environments* environments = nullptr) : environments_(environments) {}
  /// Records stay at their address until removed. Requires: neither the connection nor another one of the
  /// same instance is here.
  WorkerRecord& Add(const std::shared_ptr<Connection>& connection, const Hello& hello);
  void Remove(const Connection* connection);
  WorkerRecord* Find(const Connection* connection);
  WorkerRecord* FindById(uint32_t id);
  /// Null: no worker of this instance is here.
  WorkerRecord* FindInstance(uint64_t instance);
  const std::map<uint32_t, WorkerRecord>& all() const { return workers_; }
  std::map<uint32_t, WorkerRecord>& all() { return workers_; }

  /// Takes up a worker's counters and changes of its cache.
  static void Update(WorkerRecord& worker, const WorkerStatus& status);
  /// The workers, threads by id, that have the scene and have finished tiles of frames of late; without any,
  /// all that have the scene. The others may never answer.
  std::map<uint32_t, uint32_t> Proven() const;
  /// The workers that serve others, and their addresses.
  Peers MakePeers() const;
  /// Seconds that a worker takes to fetch and decode a stored byte of voxels, the mean over all workers;
  /// before kKnownBytes are measured, that of 100 Mbit/s without decoding. `decoded`: bytes that a stored
  /// byte becomes. A block fetched once may be decoded often, so each part is divided by its own bytes.
  double SecondsPerByte(double decoded) const;
  /// Seconds of decoding over all workers here, since each began.
  double DecodeSeconds() const;
  /// A worker other than `but` that holds the block and serves it, or 0. Depends on the block, so that
  /// several holders share the work.
  uint32_t HolderOf(uint32_t block, uint32_t but) const;

 private:
  const Environments* const environments_;
  std::map<uint32_t, WorkerRecord> workers_;  ///< by id
  std::map<const Connection*, uint32_t> ids_;
  std::map<uint64_t, uint32_t> known_;  ///< instance to id, workers that have gone too
  uint32_t next_id_ = 1;
};

}  // namespace quarry

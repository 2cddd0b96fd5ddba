#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/engine/renderer.h"
#include "common/net/liveness_monitor.h"
#include "common/net/timer.h"
#include "common/protocol/messages.h"
#include "worker/block_supply.h"
#include "worker/worker_options.h"

namespace quarry {

/// A worker's work for one master: it joins, takes up the scene, renders the tiles that it is given, and
/// reports what it holds. The renderer computes on threads of its own; everything here runs on the thread
/// that calls Run. A session keeps nothing that a master needs: when the connection is lost, it joins again
/// with its cache as it was.
class Session {
 public:
  /// `options` must outlive this.
  explicit Session(const WorkerOptions& options);
  ~Session();

  /// Works until the master says to stop, or work cannot go on. Errors: the master stays out of reach; a
  /// block cannot be had; the cache is smaller than the largest block; no memory for --pretouch.
  Status Run();

 private:
  /// The scene that the master serves, and its renderer.
  struct LoadedScene {
    LoadedScene(Catalog scene, uint64_t cache_bytes);
    const Catalog catalog;
    const uint64_t stored_bytes;  ///< of --cache, for stored blocks
    CacheInventory inventory;
    std::unique_ptr<BlockSupply> supply;
    std::unique_ptr<Renderer> renderer;  ///< last: it uses all of the above
  };

  // --- the connection
  void Join();
  void SendHello();
  void OnLost(const Error& error);
  void Heartbeat();
  /// Ends, once the master has heard the reason.
  void GiveUp(const Error& error);
  void End(Status outcome);

  // --- messages of the master
  void OnMessage(Message m);
  Status Dispatch(const Message& m);
  Status OnWelcome(const Message& m);
  Status OnCatalog(const Message& m);
  Status OnPeers(const Message& m);
  Status OnFrameSetup(const Message& m);
  Status OnTile(const Message& m);

  // --- the scene
  Status OpenSupply(LoadedScene& scene);
  Status MakeRenderer(LoadedScene& scene);

  // --- reports to the master
  void SendTile(const TileOrder& order, RenderedTile result);
  /// `whole`: all blocks held are named, not only the changes.
  void SendStatus(bool whole);
  WorkerStatus MakeStatus(bool whole);

  using Clock = std::chrono::steady_clock;
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }
  void Log(const std::string& text) const;

  const WorkerOptions& options_;
  const std::unique_ptr<boost::asio::io_context> io_;
  Timer retry_, heartbeat_;
  std::shared_ptr<Connection> connection_;  ///< null while there is none
  LivenessMonitor liveness_;                ///< of the master
  bool welcomed_ = false, was_welcomed_ = false;
  std::optional<Error> gives_up_;  ///< the reason, once work cannot go on
  Clock::time_point lost_since_;
  const uint64_t instance_;           ///< tells this run of this worker from every other; never 0
  uint32_t worker_ = 0;               ///< the master's number for this worker
  SceneId scene_id_{};                ///< as the master has named it
  std::vector<std::string> sources_;  ///< where blocks come from
  PageBuffer memory_;                 ///< of --pretouch, until the scene is known
  std::unique_ptr<LoadedScene> scene_;
  uint64_t tiles_ = 0;  ///< given so far
  Clock::time_point last_tile_;
  bool at_work_ = false;  ///< as the log says
  uint64_t peak_rss_ = 0;
  Clock::time_point peak_asked_;
  Status outcome_;
};

/// Session::Run in a session of its own.
Status RunWorker(const WorkerOptions& options);

}  // namespace quarry

#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/engine/renderer.h"
#include "common/net/liveness_monitor.h"
#include "common/net/termination.h"
#include "common/net/timer.h"
#include "common/protocol/messages.h"
#include "worker/block_supply.h"
#include "worker/kept_selections.h"
#include "worker/loaded_environments.h"
#include "worker/worker_options.h"

namespace quarry {

/// A worker's work for a master: joins it, receives the scene, renders tiles, and reports results and the
/// content of the cache. A session has no state that a master needs. After a loss of the connection it joins
/// again and keeps its cache.
/// Thread safety: none; all members run on the thread that calls Run(). The renderer has threads of its own.
class Session {
 public:
  /// Requires: `options` outlives the session.
  explicit Session(const WorkerOptions& options);
  ~Session();

  /// Works until the master ends it, until SIGTERM, or until an error. At SIGTERM it gives back the tiles
  /// that it has not begun, and ends when the others are done, within a second; a second SIGTERM ends the
  /// process. Errors: the master is out of reach for WorkerOptions::retry_s; a block cannot be had; the cache
  /// is smaller than the largest block; no memory for --pretouch.
  Status Run();

 private:
  /// The scene that the master serves, and its renderer.
  struct LoadedScene {
    LoadedScene(Catalog scene, uint64_t cache_bytes, uint64_t environment_bytes);
    const Catalog catalog;
    const uint64_t stored_bytes;  ///< share of --cache for stored blocks
    CacheInventory inventory;
    KeptSelections selections;
    std::unique_ptr<BlockSupply> supply;
    LoadedEnvironments environments;
    std::unique_ptr<Renderer> renderer;  ///< last, since it uses all of the above
  };

  // --- the connection
  void Join();
  void SendHello();
  void OnLost(const Error& error);
  void Heartbeat();
  /// Sends the reason to the master, then ends.
  void GiveUp(const Error& error);
  void End(Status outcome);

  // --- messages of the master
  void OnMessage(Message m);
  Status Dispatch(const Message& m);
  Status OnWelcome(const Message& m);
  Status OnCatalog(const Message& m);
  Status OnPeers(const Message& m);
  Status OnFrameSetup(const Message& m);
  Status OnFramesEnd(const Message& m);
  Status OnTile(const Message& m);
  Status OnRay(const Message& m);

  // --- the end by SIGTERM
  void StartLeaving();
  void GiveBack(const TileOrder& order);
  void SendLeave(bool last);
  void AwaitOpenTiles();

  // --- the scene
  SupplyOptions OptionsOf(const LoadedScene& scene);
  Status OpenSupply(LoadedScene& scene);
  Status MakeRenderer(LoadedScene& scene);

  // --- reports to the master
  void SendTile(const TileOrder& order, RenderedTile result);
  void SendHit(const RayOrder& order, const std::weak_ptr<Connection>& to, const RenderedTile& result);
  /// `whole`: lists all blocks of the cache, not only the changes.
  void SendStatus(bool whole);
  WorkerStatus MakeStatus(bool whole);
  WorkerStatus Counters() const;

  using Clock = std::chrono::steady_clock;
  static double Now() { return std::chrono::duration<double>(Clock::now().time_since_epoch()).count(); }
  void Log(const std::string& text) const;

  const WorkerOptions& options_;
  const std::unique_ptr<boost::asio::io_context> io_;
  Timer retry_, heartbeat_, leaving_;
  std::shared_ptr<Connection> connection_;  ///< null without a connection
  LivenessMonitor liveness_;                ///< of the master
  bool welcomed_ = false, was_welcomed_ = false;
  std::optional<Error> gives_up_;  ///< the reason, once work cannot go on
  bool leaves_ = false;            ///< takes no tile more
  Clock::time_point leaves_since_;
  Leave given_back_;  ///< tiles not yet reported to the master
  Clock::time_point lost_since_;
  const uint64_t instance_;           ///< random number of this run of the worker; never 0
  uint32_t worker_ = 0;               ///< the master's number for this worker
  SceneId scene_id_{};                ///< of the master's Welcome
  std::vector<std::string> sources_;  ///< of the master's Welcome
  uint64_t environment_bytes_ = 0;    ///< likewise
  std::unique_ptr<HttpServer> metrics_;
  PageBuffer memory_;  ///< of --pretouch, until the scene is known
  std::unique_ptr<LoadedScene> scene_;
  uint64_t tiles_ = 0;  ///< tiles received so far
  Clock::time_point last_tile_;
  bool at_work_ = false;  ///< the last state written to the log
  uint64_t peak_rss_ = 0;
  Clock::time_point peak_asked_;
  Status outcome_;
  std::unique_ptr<Termination> termination_;
};

/// Runs a Session. Errors: as Session::Run().
Status RunWorker(const WorkerOptions& options);

}  // namespace quarry

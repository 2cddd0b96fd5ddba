#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/net/connection.h"
#include "common/net/liveness_monitor.h"
#include "common/net/termination.h"
#include "common/net/timer.h"
#include "common/protocol/messages.h"
#include "common/remote/http_options.h"
#include "common/voxel/store_reader.h"
#include "master/block_service.h"
#include "master/cluster_status.h"
#include "master/display/display.h"
#include "master/environments.h"
#include "master/job_meter.h"
#include "master/jobs/job_frames.h"
#include "master/jobs/jobs.h"
#include "master/live_orders.h"
#include "master/part_selections.h"
#include "master/query_service.h"
#include "master/schedule/dispatcher.h"
#include "master/worker_registry.h"

namespace quarry {

struct MasterOptions {
  std::string scene;                      ///< path of the store
  std::vector<std::string> environments;  ///< places of the environments' stores
  Endpoint listen{"127.0.0.1", 0};
  bool serve_only = false;           ///< blocks only: no workers, no jobs
  std::vector<std::string> sources;  ///< where workers get voxels, as ParseSource has them; empty: here
  SchedulingPolicy policy = SchedulingPolicy::kFootprint;
  std::string spool;                      ///< folder that keeps jobs and finished frames; empty: none is kept
  uint64_t foresight_bytes = 256u << 20;  ///< cache of the footprint probe; 0: frames are not probed
  uint64_t frame_memory = 4u << 30;       ///< bytes of frames under way and of jobs
  std::string trace;                      ///< file for the tile log; empty: none
  std::optional<DisplayOptions> display;  ///< of the live view; none: there is none
  Security security;                      ///< of every connection
  HttpOptions http;                       ///< of requests for a store on a server
  bool quiet = false;
};

/// The master's sockets: greets connections, answers requests for blocks, passes jobs to Jobs and events to
/// the dispatcher, and sends its orders. Runs on the io_context's thread.
class Server {
 public:
  /// `io` and `options` must outlive this.
  Server(boost::asio::io_context& io, const MasterOptions& options, Scene scene,
         const std::vector<Scene>& environments, std::optional<Spool> spool, std::optional<TileLog> tile_log);

  /// Listens, and serves until a signal ends the program; prints on standard output "listening HOST:PORT",
  /// with a live view before it "viewing URL" and after it "serving HOST:PORT", the address of the pages
  /// here. With a spool it returns at the first SIGTERM. Errors: the address cannot be listened at.
  Status Run();

 private:
  using ConnectionPtr = std::shared_ptr<Connection>;

  SavedPictures::JobService ForViewers();
  double Now() const;
  void Log(const std::string& text) const;
  const Catalog& catalog() const { return scene_.catalog(); }

  // Connections.
  void OnConnection(const ConnectionPtr& c);
  void OnFirstOrLater(const ConnectionPtr& c, const Message& m);
  Status OnHello(const ConnectionPtr& c, const Message& m);
  Status OnMessage(const ConnectionPtr& c, Role role, const Message& m);
  void Refuse(const ConnectionPtr& c, const std::string& sentence);
  void Lose(const ConnectionPtr& c, const std::string& why);
  void OnGone(const ConnectionPtr& c, const Error& error, bool dropped);

  // Workers.
  Status CheckBlocks(const std::vector<uint32_t>& blocks) const;
  uint32_t AddWorker(const ConnectionPtr& c, const Hello& hello);
  Status OnWorkerMessage(WorkerRecord& worker, const Message& m);
  Status OnWorkerLeaves(WorkerRecord& worker, const Message& m);
  Status OnWorkerStatus(WorkerRecord& worker, const Message& m);
  Status OnTileDone(WorkerRecord& worker, const Message& m);
  Status OnRayDone(WorkerRecord& worker, const Message& m);
  Status OnWorkerFailure(const WorkerRecord& worker, const Message& m);
  void UpdateCosts();
  void SendPeers();

  // Tiles and time.
  void OnProbed();
  void WorkersChanged();
  void AssignSoon();
  void AssignTiles();
  void SendTile(AssignedTile& tile, FrameId oldest);
  void Tick();

  // The end by SIGTERM, of a master with a spool.
  void StartLeaving();
  void Farewell();
  void AwaitSent(std::vector<ConnectionPtr> peers, double since_s);

  boost::asio::io_context& io_;
  const MasterOptions& options_;
  const Scene scene_;
  const std::unique_ptr<VoxelSource> source_;
  const std::vector<uint32_t> block_bytes_;  ///< stored, by block
  BlockService blocks_;
  Environments environments_;
  Bytes packed_catalog_;
  double decoded_per_stored_ = 1;  ///< bytes, of all blocks
  const std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::unique_ptr<Listener> listener_;
  std::set<ConnectionPtr> newcomers_;  ///< have not greeted yet
  std::map<const Connection*, Role> roles_;
  LivenessMonitor liveness_;  ///< of workers and clients
  WorkerRegistry registry_{&environments_};
  bool assigning_ = false;        ///< AssignTiles() is posted
  bool workers_changed_ = false;  ///< plans and peers do not show it yet
  bool said_farewell_ = false;
  bool leaves_ = false;  ///< StartLeaving() was called
  double logged_s_ = 0;
  PartSelections selections_;
  LiveOrders orders_;
  JobMeter meter_;  ///< before `jobs_`, which ends meterings
  Jobs jobs_;
  JobFrames frames_;
  Dispatcher dispatcher_;
  ClusterStatus status_;
  QueryService queries_;
  std::unique_ptr<Display> display_;  ///< null without --http
  Timer leaving_;
  std::unique_ptr<Termination> termination_;
};

/// Serves one scene: catalog and blocks to workers, jobs from clients, tiles to workers. With a spool,
/// SIGTERM makes it keep finished frames, inform its peers and return. Errors: the store or the spool cannot
/// be opened, the address cannot be listened at, an option is unusable.
Status RunMaster(const MasterOptions& options);

}  // namespace quarry

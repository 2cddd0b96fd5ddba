#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/http/http_server.h"
#include "common/scene/scene_summary.h"
#include "master/display/live_stats.h"
#include "master/display/page.h"
#include "master/display/parts/parts_page.h"
#include "master/display/socket_refusals.h"
#include "master/display/viewer.h"
#include "master/job_meter.h"
#include "master/live_orders.h"
#include "master/query_service.h"
#include "master/worker_registry.h"

namespace quarry {

/// The live view: an HTTP server with the page, its viewers, and the tiles that workers trace for them. Runs
/// on the io_context's thread, where it also sends orders to workers; images are encoded on a thread of its
/// own.
class Display {
 public:
  /// Listens. `io`, `scene`, `environments`, `workers`, `queries` and the objects that `jobs` uses outlive
  /// it. Errors: as HttpServer::Open() and Access::Make(); (usage) an invalid viewer URL.
  static Result<std::unique_ptr<Display>> Open(boost::asio::io_context& io, const DisplayOptions& options,
                                               const Scene& scene, PartSelections& selections,
                                               const Environments& environments, WorkerRegistry& workers,
                                               QueryService& queries, SavedPictures::JobService jobs,
                                               std::function<void(const std::string&)> log);
  ~Display();

  /// The address with the token, which gives a browser access.
  std::string url() const;
  /// The port in use.
  uint16_t port() const { return server_->port(); }

  /// Whether a frame is the display's and not a job's.
  static bool Owns(FrameId frame) { return frame >= kFirstLiveFrame && !JobMeter::Owns(frame); }
  /// The worker has the scene and takes tiles.
  void WorkerReady(const WorkerRecord& worker);
  /// The worker takes no more tiles. `lost`: the sentence for viewers; empty when it has left in order.
  void WorkerGone(uint32_t id, const std::string& lost = {});
  /// Shows viewers a sentence for a while.
  void Notify(const std::string& sentence);
  /// A worker could not continue, for a reason to show to viewers.
  void WorkerFailed(const std::string& sentence);
  /// A result of a frame that the display owns. Errors: it does not fit its tile.
  Status OnTileDone(uint32_t worker, const TileDone& done, std::span<const std::byte> pixels);
  /// The hit of one of the display's rays. A hit that nobody waits for is ignored.
  void OnRayDone(uint32_t worker, const RayDone& done) { rays_.Finish(worker, done); }
  /// Called several times a second.
  void Tick();

 private:
  Display(boost::asio::io_context& io, const DisplayOptions& options, const Scene& scene,
          PartSelections& selections, const Environments& environments, WorkerRegistry& workers,
          Access access, SavedPictures::JobService jobs, std::function<void(const std::string&)> log);

  HttpResponse OnRequest(const HttpRequest& request);
  HttpResponse OnPrivate(const HttpRequest& request, const std::string& name) const;
  HttpResponse OnLostUpgrade(const HttpRequest& request);
  HttpResponse MayUpgrade(const HttpRequest& request);
  HttpResponse MayOpen(const HttpRequest& request) const;
  void OnSocket(std::shared_ptr<WebSocket> socket);
  void OnScene(const Result<std::string>& description);
  void Welcome(const std::shared_ptr<Viewer>& viewer);
  void SendState();
  void AssignSoon();
  double Now() const;
  DisplayCounters Counters() const;

  boost::asio::io_context& io_;
  const DisplayOptions options_;
  WorkerRegistry& workers_;
  const Access access_;
  const std::function<void(const std::string&)> log_;
  LiveOrders orders_;
  LiveDispatcher dispatcher_;
  RayDispatcher rays_;
  LiveStats stats_;
  SocketRefusals refusals_;
  std::optional<Result<SceneSummary>> summary_;
  std::string welcome_;  ///< JSON; empty until the scene is known
  std::string failure_;  ///< the reason of the last worker that ended, when none is left
  std::string lost_;     ///< the sentence about the worker that was lost last
  std::string state_;    ///< JSON that was sent to viewers last
  uint64_t frames_of_gone_ = 0, abandoned_of_gone_ = 0;
  uint32_t next_viewer_ = 1;
  double reported_s_ = 0;
  bool assigning_ = false;
  EncodingThread moving_, exact_;
  const std::unique_ptr<VoxelSource> source_;
  SavedPictures saved_;
  ViewerSite site_;
  const PartsPage parts_page_;
  std::map<uint32_t, std::shared_ptr<Viewer>> viewers_;
  std::vector<std::shared_ptr<Viewer>> departed_;  ///< whose callers may still run
  std::unique_ptr<HttpServer> server_;             ///< last: its handlers use the members above
};

}  // namespace quarry

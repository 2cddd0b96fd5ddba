#include "master/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "common/base/resource.h"
#include "common/protocol/messages.h"
#include "master/active_frame.h"
#include "master/image_output.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;
using ConnectionPtr = std::shared_ptr<Connection>;

constexpr double kSilenceIsDeathS = 8;  // workers speak every second
constexpr auto kTick = std::chrono::milliseconds(250);
constexpr uint64_t kMaxQueuedBytes = 256u << 20;  // a peer that does not read is dropped beyond this

struct Worker {
  ConnectionPtr connection;
  uint32_t id = 0;
  std::string name;
  uint32_t threads = 1;
  double heard_s = 0;
  uint64_t setup = 0;  ///< the last it was told of
  Alive counters;
  uint32_t tiles = 0;
};

/// A client's job, frame after frame.
struct Job {
  ConnectionPtr client;
  RenderJob job;
  size_t next_camera = 0;
};

class Server {
 public:
  Server(const MasterOptions& options, StoreReader store)
      : options_(options), store_(std::move(store)), timer_(io_), start_(Clock::now()) {
    packed_catalog_ = PackSections(store_.catalog_sections());
  }

  Status Run() {
    QUARRY_ASSIGN(listener_, Listener::Open(io_, options_.listen, options_.security,
                                            [this](ConnectionPtr c) { OnConnection(c); }));
    fmt::print("listening {}:{}\n", options_.listen.host, listener_->port());
    std::fflush(stdout);
    Tick();
    io_.run();
    return {};
  }

 private:
  double Now() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  void Log(const std::string& text) const {
    if (!options_.quiet) fmt::print(stderr, "quarry-master: {}\n", text);
  }

  // --- connections

  void OnConnection(const ConnectionPtr& c) {
    newcomers_.insert(c);
    c->Start([this, c](Message m) { OnHello(c, m); },
             [this, c](const Error& e) {
               newcomers_.erase(c);
               OnGone(c, e);
             });
  }

  void Refuse(const ConnectionPtr& c, const std::string& sentence) {
    c->Send(MakeMessage(MessageType::kFailure, Failure{sentence}));
    c->Close();
    newcomers_.erase(c);
    OnGone(c, Error{fmt::format("{} is dropped: {}", c->peer(), sentence)});
  }

  /// Every message after the first: by role. `c` keeps itself alive by its handlers.
  void OnHello(const ConnectionPtr& c, const Message& m) {
    if (const auto it = roles_.find(c.get()); it != roles_.end()) {
      const Status status = OnMessage(c, it->second, m);
      if (!status) Refuse(c, status.error().message);
      return;
    }
    const auto hello =
        m.type == MessageType::kHello ? DecodeHello(m.table) : Result<Hello>(Fail("no greeting"));
    if (!hello) return Refuse(c, hello.error().message);
    if (options_.serve_only && hello->role != Role::kVoxels)
      return Refuse(c, "this server only serves voxels (--serve-only)");
    newcomers_.erase(c);
    roles_[c.get()] = hello->role;
    Welcome welcome{store_.catalog().id, 0};
    if (hello->role == Role::kWorker) welcome.worker = AddWorker(c, *hello);
    c->Send(MakeMessage(MessageType::kWelcome, welcome));
    if (hello->role == Role::kWorker) {
      c->Send({MessageType::kCatalog, 0, {}, packed_catalog_});
      HandOut();
    }
  }

  Status OnMessage(const ConnectionPtr& c, Role role, const Message& m) {
    if (c->queued_bytes() > kMaxQueuedBytes) return Fail("you do not read what you asked for");
    if (role == Role::kVoxels && m.type == MessageType::kBlockRequest) return OnBlockRequest(c, m);
    if (role == Role::kClient && m.type == MessageType::kRenderJob) return OnRenderJob(c, m);
    if (role == Role::kWorker && workers_.contains(c.get())) {
      Worker& worker = workers_[c.get()];
      worker.heard_s = Now();
      if (m.type == MessageType::kTileDone) return OnTileDone(worker, m);
      if (m.type == MessageType::kFailure) return OnWorkerFailure(worker, m);
      if (m.type == MessageType::kAlive) {
        QUARRY_ASSIGN(worker.counters, DecodeAlive(m.table));
        return {};
      }
    }
    return Fail(fmt::format("a message of type {} does not belong here", static_cast<int>(m.type)));
  }

  void OnGone(const ConnectionPtr& c, const Error& error) {
    roles_.erase(c.get());
    if (const auto it = workers_.find(c.get()); it != workers_.end()) {
      const uint32_t id = it->second.id;
      Log(fmt::format("worker {} is gone: {}", it->second.name, error.message));
      workers_.erase(it);
      if (frame_) frame_->Forget(id);
      HandOut();
      return;
    }
    Log(error.message);
    if (!jobs_.empty() && jobs_.front().client == c) frame_.reset();
    std::erase_if(jobs_, [&](const Job& job) { return job.client == c; });
    if (!frame_) NextFrame();
  }

  // --- voxels

  Status OnBlockRequest(const ConnectionPtr& c, const Message& m) {
    QUARRY_ASSIGN(const BlockRequest request, DecodeBlockRequest(m.table));
    auto block = store_.ReadBlock(request.block);
    if (block) {
      voxel_bytes_served_ += block->size();
      c->Send({MessageType::kBlock, m.request, {}, std::move(*block)});
    } else {
      c->Send(MakeMessage(MessageType::kFailure, Failure{block.error().message}, m.request));
    }
    return {};
  }

  // --- workers and tiles

  uint32_t AddWorker(const ConnectionPtr& c, const Hello& hello) {
    Worker worker;
    worker.connection = c;
    worker.id = next_worker_++;
    worker.name = hello.name;
    worker.threads = std::max(1u, hello.threads);
    worker.heard_s = Now();
    Log(fmt::format("worker {} has joined with {} threads", worker.name, worker.threads));
    workers_[c.get()] = worker;
    return worker.id;
  }

  /// Tiles a worker may hold: enough that none of its threads idles while an answer is on its way.
  static uint32_t Credit(const Worker& worker) { return worker.threads * 2 + 2; }

  void HandOut() {
    if (!frame_ || frame_->done()) return;
    std::vector<WorkerView> views;
    std::map<uint32_t, Worker*> by_id;
    for (auto& [key, worker] : workers_) by_id[worker.id] = &worker;
    for (auto& [id, worker] : by_id) {
      const uint32_t held = frame_->Held(id);
      views.push_back({id, Credit(*worker) > held ? Credit(*worker) - held : 0});
    }
    const auto snapshot = frame_->MakeSnapshot(std::move(views), Now());
    for (const Assignment& a : Schedule(snapshot, SchedulingPolicy::kLastOwner)) {
      Worker& worker = *by_id.at(a.worker);
      if (worker.setup != frame_->setup()) {
        worker.setup = frame_->setup();
        worker.connection->Send(
            MakeMessage(MessageType::kFrameSetup, FrameSetup{frame_->setup(), frame_->job()}));
      }
      worker.connection->Send(MakeMessage(MessageType::kTile, frame_->Lease(a, Now())));
    }
  }

  Status OnTileDone(Worker& worker, const Message& m) {
    QUARRY_ASSIGN(const TileDone done, DecodeTileDone(m.table));
    if (!frame_) return {};
    QUARRY_ASSIGN(const bool kept, frame_->Finish(done, m.raw));
    if (kept) ++worker.tiles;
    if (frame_->done()) {
      FinishFrame();
    } else {
      HandOut();
    }
    return {};
  }

  Status OnWorkerFailure(Worker& worker, const Message& m) {
    QUARRY_ASSIGN(const Failure failure, DecodeFailure(m.table));
    const std::string name = worker.name;
    if (!jobs_.empty()) FailJob(failure.message);
    return Fail(failure.message);
  }

  // --- jobs and frames

  Status OnRenderJob(const ConnectionPtr& c, const Message& m) {
    QUARRY_ASSIGN(RenderJob job, DecodeRenderJob(m.table));
    jobs_.push_back({c, std::move(job)});
    if (!frame_) NextFrame();
    return {};
  }

  void FailJob(const std::string& sentence) {
    const ConnectionPtr client = jobs_.front().client;
    frame_.reset();
    jobs_.pop_front();
    client->Send(MakeMessage(MessageType::kFailure, Failure{sentence}));
    NextFrame();
  }

  void NextFrame() {
    if (frame_ || jobs_.empty()) return;
    Job& job = jobs_.front();
    RenderJob one = job.job;
    one.cameras = {job.job.cameras[job.next_camera]};
    one.first_frame = job.job.first_frame + static_cast<uint32_t>(job.next_camera);
    ++job.next_camera;
    frame_ = std::make_unique<ActiveFrame>(next_setup_++, one, std::exchange(owners_, {}));
    frame_start_s_ = Now();
    frame_bytes_start_ = voxel_bytes_served_;
    for (auto& [key, worker] : workers_) worker.tiles = 0;
    HandOut();
  }

  void FinishFrame() {
    owners_ = frame_->owners();
    Job& job = jobs_.front();
    auto image = EncodeImage(frame_->job(), frame_->frame().pixels());
    if (!image) return FailJob(image.error().message);
    Message m = MakeMessage(MessageType::kFrameDone, FrameDone{frame_->job().first_frame, FrameStatistics()});
    m.raw = std::move(*image);
    job.client->Send(std::move(m));
    frame_.reset();
    if (job.next_camera == job.job.cameras.size()) jobs_.pop_front();
    NextFrame();
  }

  std::string FrameStatistics() const {
    nlohmann::ordered_json j;
    j["frame"] = frame_->job().first_frame;
    j["frame_wall_s"] = Now() - frame_start_s_;
    j["tiles"] = frame_->frame().tiles().size();
    j["rays"] = frame_->rays();
    j["rays_suspended"] = frame_->rays_suspended();
    j["leases_lost"] = frame_->leases_lost();
    j["voxel_bytes_served"] = voxel_bytes_served_ - frame_bytes_start_;
    j["master_peak_rss_bytes"] = PeakResidentBytes();
    j["workers"] = nlohmann::ordered_json::array();
    for (const auto& [key, w] : workers_) {
      nlohmann::ordered_json one;
      one["name"] = w.name;
      one["tiles"] = w.tiles;
      one["cache_bytes"] = w.counters.cache_bytes;
      one["voxel_blocks_loaded"] = w.counters.voxels_loaded;
      one["voxel_bytes_loaded"] = w.counters.voxel_bytes_loaded;
      one["voxel_bytes_received"] = w.counters.voxel_bytes_received;
      one["evictions"] = w.counters.evictions;
      one["rays"] = w.counters.rays;
      one["rays_suspended"] = w.counters.rays_suspended;
      one["peak_rss_bytes"] = w.counters.peak_rss_bytes;
      j["workers"].push_back(one);
    }
    return j.dump();
  }

  // --- time

  void Tick() {
    std::vector<ConnectionPtr> dead;
    for (const auto& [key, worker] : workers_)
      if (Now() - worker.heard_s > kSilenceIsDeathS) dead.push_back(worker.connection);
    for (const ConnectionPtr& c : dead) Refuse(c, fmt::format("silent for {:.0f} seconds", kSilenceIsDeathS));
    HandOut();
    if (frame_)
      jobs_.front().client->Send(MakeMessage(
          MessageType::kFrameProgress, FrameProgress{frame_->job().first_frame, frame_->tiles_done(),
                                                     static_cast<uint32_t>(frame_->frame().tiles().size()),
                                                     static_cast<uint32_t>(workers_.size())}));
    timer_.expires_after(kTick);
    timer_.async_wait([this](const boost::system::error_code& e) {
      if (!e) Tick();
    });
  }

  const MasterOptions& options_;
  StoreReader store_;
  Bytes packed_catalog_;
  asio::io_context io_;
  asio::steady_timer timer_;
  Clock::time_point start_;
  std::unique_ptr<Listener> listener_;
  std::set<ConnectionPtr> newcomers_;
  std::map<const Connection*, Role> roles_;
  std::map<const Connection*, Worker> workers_;
  uint32_t next_worker_ = 1;
  std::deque<Job> jobs_;
  std::unique_ptr<ActiveFrame> frame_;
  std::vector<uint32_t> owners_;
  uint64_t next_setup_ = 1;
  double frame_start_s_ = 0;
  uint64_t voxel_bytes_served_ = 0, frame_bytes_start_ = 0;
};

}  // namespace

Status RunMaster(const MasterOptions& options) {
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(options.scene));
  Server server(options, std::move(store));
  return server.Run();
}

}  // namespace quarry

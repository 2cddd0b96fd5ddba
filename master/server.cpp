#include "master/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <set>
#include <thread>
#include <utility>

#include "common/base/resource.h"
#include "common/net/file_source.h"
#include "common/net/source_set.h"
#include "common/protocol/messages.h"
#include "master/active_frame.h"
#include "master/image_output.h"
#include "master/job.h"
#include "master/roster.h"
#include "master/spool.h"
#include "master/tile_log.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;
using ConnectionPtr = std::shared_ptr<Connection>;

constexpr auto kTick = std::chrono::milliseconds(250);
constexpr uint64_t kMaxQueuedBytes = 256u << 20;  // a peer that does not read is dropped beyond this
constexpr uint64_t kFullQueueBytes = 32u << 20;   // no further frames are queued for a client beyond this
constexpr int kMostEncoding = 4;      // frames on their way to the disk; no other begins beyond this
constexpr float kLeastChance = 0.5;   // that a tile touches a block, for the block to be fetched ahead
constexpr double kClientGraceS = 20;  // a job without a spool waits so long for its client to come back
constexpr double kLogEveryS = 10;
constexpr uint32_t kMostFailures = 3;  // workers that fail before the job is given up

/// A frame being rendered.
struct Rendering {
  std::shared_ptr<Job> job;
  size_t index = 0;  ///< of the job's frames
  std::unique_ptr<ActiveFrame> frame;
  double start_s = 0;
  uint64_t bytes_served_before = 0;
};

/// When a connection was last heard of.
struct Pulse {
  double heard_s = 0;
  uint64_t received = 0;
};

class Server {
 public:
  Server(const MasterOptions& options, StoreReader store, std::optional<Spool> spool,
         std::optional<TileLog> tile_log)
      : options_(options),
        source_(io_, std::move(store)),
        spool_(std::move(spool)),
        tile_log_(std::move(tile_log)),
        timer_(io_),
        start_(Clock::now()),
        next_setup_((uint64_t{std::random_device{}()} << 24) + 1) {
    const Catalog& catalog = source_.store().catalog();
    packed_catalog_ = PackSections(source_.store().catalog_sections());
    for (uint32_t b = 0; b < catalog.voxels.size() * 2; ++b) block_bytes_.push_back(catalog.block(b).stored);
  }

  Status Run() {
    QUARRY_ASSIGN(listener_, Listener::Open(io_, options_.listen, options_.security,
                                            [this](ConnectionPtr c) { OnConnection(c); }));
    fmt::print("listening {}:{}\n", options_.listen.host, listener_->port());
    std::fflush(stdout);
    if (spool_) TakeUpJobs();
    Tick();
    io_.run();
    return {};
  }

 private:
  double Now() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  void Log(const std::string& text) const {
    if (!options_.quiet) fmt::print(stderr, "quarry-master: {}\n", text);
  }
  const Catalog& catalog() const { return source_.store().catalog(); }

  // --- connections

  void OnConnection(const ConnectionPtr& c) {
    newcomers_.insert(c);
    c->Start([this, c](const Message& m) { OnAny(c, m); },
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

  /// Without a sentence: whoever it is may come back.
  void Lose(const ConnectionPtr& c, const std::string& why) {
    c->Close();
    newcomers_.erase(c);
    OnGone(c, Error{fmt::format("{} is dropped: {}", c->peer(), why)});
  }

  void OnAny(const ConnectionPtr& c, const Message& m) {
    const auto role = roles_.find(c.get());
    const Status status = role != roles_.end() ? OnMessage(c, role->second, m) : OnHello(c, m);
    if (!status) Refuse(c, status.error().message);
  }

  Status OnHello(const ConnectionPtr& c, const Message& m) {
    if (m.type != MessageType::kHello) return Fail("no greeting");
    QUARRY_ASSIGN(const Hello hello, DecodeHello(m.table));
    if (options_.serve_only && hello.role != Role::kVoxels)
      return Fail("this server only serves voxels (--serve-only)");
    newcomers_.erase(c);
    roles_[c.get()] = hello.role;
    if (hello.role != Role::kVoxels) pulses_[c] = {Now(), 0};
    Welcome welcome{catalog().id, 0, options_.sources};
    if (hello.role == Role::kWorker) welcome.worker = AddWorker(c, hello);
    c->Send(MakeMessage(MessageType::kWelcome, welcome));
    if (hello.role == Role::kWorker) {
      c->Send({MessageType::kCatalog, 0, {}, packed_catalog_});
      WorkersChanged();
    }
    return {};
  }

  /// Every message after the first: by role.
  Status OnMessage(const ConnectionPtr& c, Role role, const Message& m) {
    if (c->queued_bytes() > kMaxQueuedBytes) return Lose(c, "it does not read what it asked for"), Status{};
    if (m.type == MessageType::kPing) return {};
    if (role == Role::kVoxels && m.type == MessageType::kBlockRequest) return OnBlockRequest(c, m);
    if (role == Role::kClient && m.type == MessageType::kRenderJob) return OnJobRequest(c, m);
    WorkerRecord* worker = role == Role::kWorker ? roster_.Find(c.get()) : nullptr;
    if (worker && m.type == MessageType::kTileDone) return OnTileDone(*worker, m);
    if (worker && m.type == MessageType::kFailure) return OnWorkerFailure(*worker, m);
    if (worker && m.type == MessageType::kHello) return OnServesAt(*worker, m);
    if (worker && m.type == MessageType::kAlive) {
      QUARRY_ASSIGN(const Alive alive, DecodeAlive(m.table));
      QUARRY_TRY(CheckBlocks(alive.cached));
      QUARRY_TRY(CheckBlocks(alive.dropped));
      Roster::Update(*worker, alive);
      if (alive.whole) {  // it has the scene now, or has come back with its cache
        worker->has_scene = true;
        WorkersChanged();
      }
      return {};
    }
    return Fail(fmt::format("a message of type {} does not belong here", static_cast<int>(m.type)));
  }

  void OnGone(const ConnectionPtr& c, const Error& error) {
    roles_.erase(c.get());
    pulses_.erase(c);
    if (const WorkerRecord* worker = roster_.Find(c.get())) {
      const uint32_t id = worker->id;
      Log(fmt::format("worker {} is gone: {}", worker->name, error.message));
      roster_.Remove(c.get());
      for (Rendering& r : renderings_) r.frame->Forget(id);
      WorkersChanged();
      return;
    }
    for (auto& job : jobs_)
      if (std::erase_if(job->clients, [&](const Job::Client& client) { return client.connection == c; }) > 0)
        job->alone_since_s = Now();
    Log(error.message);
  }

  // --- voxels

  Status OnBlockRequest(const ConnectionPtr& c, const Message& m) {
    QUARRY_ASSIGN(const BlockRequest request, DecodeBlockRequest(m.table));
    source_.Fetch(request.block, [this, c, id = m.request](Result<Bytes> block) {
      if (!block) return c->Send(MakeMessage(MessageType::kFailure, Failure{block.error().message}, id));
      voxel_bytes_served_ += block->size();
      c->Send({MessageType::kBlock, id, {}, std::move(*block)});
    });
    return {};
  }

  // --- workers and tiles

  /// Sets of blocks are as large as the largest number in them.
  Status CheckBlocks(const std::vector<uint32_t>& blocks) const {
    for (const uint32_t block : blocks)
      if (block >= block_bytes_.size()) return Fail(fmt::format("block {}: there is none", block));
    return {};
  }

  uint32_t AddWorker(const ConnectionPtr& c, const Hello& hello) {
    // The same worker on a connection that is not yet known to be lost.
    if (const WorkerRecord* old = roster_.FindInstance(hello.instance)) {
      const ConnectionPtr lost = old->connection;
      Refuse(lost, "you are here a second time");
    }
    const WorkerRecord& worker = roster_.Add(c, hello);
    Log(fmt::format("worker {} has joined with {} threads", worker.name, worker.threads));
    return worker.id;
  }

  /// A worker says at which port it serves others.
  Status OnServesAt(WorkerRecord& worker, const Message& m) {
    QUARRY_ASSIGN(const Hello hello, DecodeHello(m.table));
    worker.SetServesAt(hello.serves_at);
    return {};
  }

  void WorkersChanged() {
    const Peers peers = roster_.MakePeers();
    for (auto& [id, worker] : roster_.all())
      if (worker.has_scene) worker.connection->Send(MakeMessage(MessageType::kPeers, peers));
    for (size_t r = 0; r < renderings_.size(); ++r) MakePlan(r);
    HandOutSoon();
  }

  /// Of one of the frames under way, which comes after those before it.
  void MakePlan(size_t rendering) {
    std::map<uint32_t, BlockSet> holds;
    for (const auto& [id, worker] : roster_.all()) holds[id] = worker.holds;
    for (size_t r = 0; r < rendering; ++r) renderings_[r].frame->AddPromised(holds);
    std::vector<PlannedWorker> workers;
    for (const auto& [id, worker] : roster_.all())
      workers.push_back({id, static_cast<double>(worker.threads), &holds[id]});
    renderings_[rendering].frame->MakePlan(workers, block_bytes_, roster_.SecondsPerByte(), options_.policy);
  }

  /// Once for all the messages at hand.
  void HandOutSoon() {
    if (std::exchange(handing_out_, true)) return;
    asio::post(io_, [this] {
      handing_out_ = false;
      HandOut();
    });
  }

  void HandOut() {
    std::vector<ActiveFrame*> frames;
    for (Rendering& r : renderings_) frames.push_back(r.frame.get());
    std::vector<Hand> hands;
    for (const auto& [id, worker] : roster_.all()) hands.push_back({id, worker.Credit()});
    std::function<double(const ActiveFrame&, uint32_t, uint32_t)> fetch_s;
    if (options_.policy == SchedulingPolicy::kFootprint)
      fetch_s = [this, per_byte = roster_.SecondsPerByte()](const ActiveFrame& frame, uint32_t tile,
                                                            uint32_t worker) {
        return ExpectedBytes(frame.Expected(tile), roster_.FindById(worker)->holds, block_bytes_) * per_byte;
      };
    for (HandedTile& tile :
         quarry::HandOut(std::move(frames), hands, Now(), fetch_s, [this] { return StartFrame(); })) {
      WorkerRecord& worker = *roster_.FindById(tile.worker);
      const uint64_t setup = tile.order.setup, oldest = renderings_.front().frame->setup();
      if (worker.setups.insert(setup).second) {
        worker.connection->Send(
            MakeMessage(MessageType::kFrameSetup, FrameSetup{setup, tile.frame->job(), oldest}));
        worker.setups.erase(worker.setups.begin(), worker.setups.lower_bound(oldest));
      }
      AddHints(tile, worker);
      worker.connection->Send(MakeMessage(MessageType::kTile, tile.order));
    }
  }

  /// What the tile is expected to touch and the worker lacks.
  void AddHints(HandedTile& tile, const WorkerRecord& worker) const {
    const TileTrace& expected = tile.frame->Expected(tile.order.tile);
    for (size_t i = 0; i < expected.blocks.size() && tile.order.blocks.size() < kMaxTileHints; ++i) {
      const uint32_t block = expected.blocks[i];
      if (expected.chances[i] < kLeastChance || worker.holds.Has(block)) continue;
      tile.order.blocks.push_back(block);
      tile.order.holders.push_back(roster_.HolderOf(block, worker.id));
    }
  }

  Status OnTileDone(WorkerRecord& worker, const Message& m) {
    QUARRY_ASSIGN(const TileDone done, DecodeTileDone(m.table));
    QUARRY_TRY(CheckBlocks(done.blocks));
    HandOutSoon();
    for (Rendering& r : renderings_) {
      if (r.frame->setup() != done.setup) continue;
      QUARRY_ASSIGN(const bool kept, r.frame->Finish(done, m.raw, Now()));
      worker.tiles += kept;
      if (kept && tile_log_) tile_log_->Tile(*r.frame, done, worker.name);
      if (r.frame->done()) FinishFrame(done.setup);
      return {};
    }
    return {};  // of a frame that is over
  }

  /// A worker cannot get a block. Others may; when none is left, or several have said so, the job cannot be
  /// done.
  Status OnWorkerFailure(const WorkerRecord& worker, const Message& m) {
    QUARRY_ASSIGN(const Failure failure, DecodeFailure(m.table));
    if (!renderings_.empty() && (++failures_ >= kMostFailures || roster_.all().size() == 1))
      FailJob(renderings_.front().job, failure.message);
    Log(fmt::format("worker {} gives up: {}", worker.name, failure.message));
    return Fail(failure.message);
  }

  // --- jobs and frames

  void TakeUpJobs() {
    for (Spool::Found& found : spool_->Jobs([this](const std::string& line) { Log(line); })) {
      auto job = std::make_shared<Job>(found.id, std::move(found.job));
      for (size_t f = 0; f < found.finished.size(); ++f)
        if (found.finished[f]) job->states[f] = Job::FrameState::kFinished;
      Log(fmt::format("going on with job {}: {} of {} frames are done", job->id,
                      std::count(found.finished.begin(), found.finished.end(), true), found.finished.size()));
      jobs_.push_back(std::move(job));
    }
  }

  Status OnJobRequest(const ConnectionPtr& c, const Message& m) {
    QUARRY_ASSIGN(JobRequest request, DecodeJobRequest(m.table));
    const std::string id = JobId(catalog().id, request.job);
    auto job = std::find_if(jobs_.begin(), jobs_.end(), [&](const auto& j) { return j->id == id; });
    if (job == jobs_.end()) {
      jobs_.push_back(std::make_shared<Job>(id, std::move(request.job)));
      job = std::prev(jobs_.end());
      // What its client has need not be made again; should another one ask for it, it is.
      std::fill_n((*job)->states.begin(), request.have, Job::FrameState::kFinished);
      if (spool_)
        asio::post(encoder_, [this, begun = *job] {
          WriteToSpool(*begun, [&] { return spool_->Begin(begun->id, begun->job); });
        });
    }
    (*job)->clients.push_back({c, request.have});
    Deliver(**job);
    HandOutSoon();
    return {};
  }

  // By value: whoever calls holds the job in one of the lists that it is taken out of.
  void FailJob(std::shared_ptr<Job> job, const std::string& sentence) {
    for (const Job::Client& client : job->clients)
      client.connection->Send(MakeMessage(MessageType::kFailure, Failure{sentence}));
    RemoveJob(std::move(job));
  }

  void RemoveJob(std::shared_ptr<Job> job) {
    std::erase_if(renderings_, [&](const Rendering& r) { return r.job == job; });
    job->over = true;
    if (spool_) spool_->Remove(job->id);
    std::erase(jobs_, job);
  }

  /// The next frame. Null when none begins.
  ActiveFrame* StartFrame() {
    if (renderings_.size() >= kFramesAtOnce || encoding_ >= kMostEncoding) return nullptr;
    for (const auto& job : jobs_) {
      const size_t index = job->NextToDo();
      if (index == job->states.size()) continue;
      RenderJob one = job->job;
      one.cameras = {job->job.cameras[index]};
      one.first_frame = job->job.first_frame + static_cast<uint32_t>(index);
      const ActiveFrame* before = renderings_.empty() ? previous_.get() : renderings_.back().frame.get();
      auto frame = std::make_unique<ActiveFrame>(next_setup_++, one, before);
      if (tile_log_) tile_log_->Frame(*frame);
      job->states[index] = Job::FrameState::kActive;
      failures_ = 0;
      renderings_.push_back({job, index, std::move(frame), Now(), voxel_bytes_served_});
      MakePlan(renderings_.size() - 1);
      return renderings_.back().frame.get();
    }
    return nullptr;
  }

  /// The image is made, and written, on a thread of its own.
  void FinishFrame(uint64_t setup) {
    const auto it = std::find_if(renderings_.begin(), renderings_.end(),
                                 [&](const Rendering& r) { return r.frame->setup() == setup; });
    Rendering done = std::move(*it);
    renderings_.erase(it);
    ++encoding_;
    asio::post(encoder_, [this, job = done.job, index = done.index, one = done.frame->job(),
                          pixels = done.frame->TakePixels(), statistics = FrameStatistics(done)]() mutable {
      auto image = EncodeImage(one, pixels);
      if (image && spool_)
        WriteToSpool(*job, [&] { return spool_->WriteFrame(job->id, job->job, index, *image); });
      asio::post(io_,
                 [this, job, index, image = std::move(image), statistics = std::move(statistics)]() mutable {
                   OnImage(job, index, std::move(image), std::move(statistics));
                 });
    });
    previous_ = std::move(done.frame);
    HandOutSoon();
  }

  /// Does it until it is done: a full disk may get space. Nothing more for a job that is over.
  template <class Write>
  void WriteToSpool(const Job& job, Write write) const {
    for (bool told = false; !job.over; told = true) {
      const Status status = write();
      if (status) break;
      if (!told) Log(status.error().message + "; trying every second");
      std::this_thread::sleep_for(std::chrono::seconds(1));
    }
    if (job.over) spool_->Remove(job.id);  // it may have ended while this was at work
  }

  void OnImage(const std::shared_ptr<Job>& job, size_t index, Result<Bytes> image, std::string statistics) {
    --encoding_;
    HandOutSoon();
    if (std::find(jobs_.begin(), jobs_.end(), job) == jobs_.end()) return;
    if (!image) return FailJob(job, image.error().message);
    job->states[index] = Job::FrameState::kFinished;
    job->finished[index] = {std::move(*image), std::move(statistics)};
    Deliver(*job);
  }

  /// Sends finished frames on, in order; lets go of a job that everyone has.
  void Deliver(Job& job) {
    size_t needed = job.states.size();
    for (Job::Client& client : job.clients) {
      while (client.next < job.states.size() && job.states[client.next] == Job::FrameState::kFinished &&
             client.connection->queued_bytes() < kFullQueueBytes && SendFrame(job, client))
        ++client.next;
      needed = std::min(needed, client.next);
    }
    if (job.clients.empty()) needed = 0;
    for (size_t f = 0; f < (spool_ ? job.states.size() : needed); ++f) job.finished[f].image = {};
    if (needed < job.states.size()) return;
    RemoveJob(*std::find_if(jobs_.begin(), jobs_.end(), [&](const auto& j) { return j.get() == &job; }));
  }

  /// False when the image is not there any more: the frame is rendered again.
  bool SendFrame(Job& job, const Job::Client& client) {
    const size_t f = client.next;
    Bytes image = job.finished[f].image;
    if (image.empty() && spool_) {
      auto read = spool_->ReadFrame(job.id, job.job, f);
      if (read) image = std::move(*read);
    }
    if (image.empty()) {
      job.states[f] = Job::FrameState::kToDo;
      HandOutSoon();
      return false;
    }
    const std::string statistics = job.finished[f].statistics.empty() ? "{}" : job.finished[f].statistics;
    Message m = MakeMessage(MessageType::kFrameDone,
                            FrameDone{job.job.first_frame + static_cast<uint32_t>(f), statistics});
    m.raw = std::move(image);
    client.connection->Send(std::move(m));
    return true;
  }

  // --- statistics

  std::string FrameStatistics(const Rendering& r) const {
    nlohmann::ordered_json j;
    j["frame"] = r.frame->job().first_frame;
    j["frame_wall_s"] = Now() - r.start_s;
    j["frame_start_s"] = r.start_s;
    j["tiles"] = r.frame->frame().tiles().size();
    j["rays"] = r.frame->rays();
    j["rays_suspended"] = r.frame->rays_suspended();
    j["leases_lost"] = r.frame->leases_lost();
    j["voxel_bytes_served"] = voxel_bytes_served_ - r.bytes_served_before;
    j["master_peak_rss_bytes"] = PeakResidentBytes();
    j["workers"] = nlohmann::ordered_json::array();
    for (const auto& [id, worker] : roster_.all()) j["workers"].push_back(WorkerStatistics(worker));
    return j.dump();
  }

  static nlohmann::ordered_json WorkerStatistics(const WorkerRecord& w) {
    static const char* const kinds[kSourceKinds] = {"file", "tcp", "http", "peer", "disk", "memory"};
    const Alive& c = w.counters;
    nlohmann::ordered_json j;
    j["name"] = w.name;
    j["tiles"] = w.tiles;
    j["cache_bytes"] = c.cache_bytes;
    j["voxel_blocks_loaded"] = c.voxels_loaded;
    j["voxel_bytes_loaded"] = c.voxel_bytes_loaded;
    j["voxel_bytes_received"] = c.voxel_bytes_received;
    for (size_t k = 0; k < kSourceKinds; ++k)
      j[fmt::format("voxel_bytes_from_{}", kinds[k])] = c.bytes_from[k];
    j["evictions"] = c.evictions;
    j["rays"] = c.rays;
    j["rays_suspended"] = c.rays_suspended;
    j["fetch_s"] = static_cast<double>(c.fetch_us) * 1e-6;
    j["compute_s"] = static_cast<double>(c.compute_us) * 1e-6;
    j["stall_s"] = static_cast<double>(c.stall_us) * 1e-6;
    j["source_retries"] = c.retries;
    j["source_hedges"] = c.hedges;
    j["blocks_damaged"] = c.damaged;
    j["prefetched_bytes"] = c.prefetched_bytes;
    j["prefetch_wasted_bytes"] = c.prefetch_wasted_bytes;
    j["peak_rss_bytes"] = c.peak_rss_bytes;
    return j;
  }

  void LogProgress() {
    if (renderings_.empty()) return;
    Alive sum;
    for (const auto& [id, w] : roster_.all()) {
      sum.rays += w.counters.rays;
      sum.voxel_bytes_received += w.counters.voxel_bytes_received;
      sum.stall_us += w.counters.stall_us;
      sum.compute_us += w.counters.compute_us;
    }
    const Rendering& r = renderings_.front();
    Log(
        fmt::format("frame {}: {} of {} tiles; {} workers, {:.1f} million rays, {:.1f} MB of voxels "
                    "received, {:.1f} s of "
                    "computing, {:.1f} s of waiting so far",
                    r.frame->job().first_frame, r.frame->tiles_done(), r.frame->frame().tiles().size(),
                    roster_.all().size(), static_cast<double>(sum.rays) * 1e-6,
                    static_cast<double>(sum.voxel_bytes_received) * 1e-6,
                    static_cast<double>(sum.compute_us) * 1e-6, static_cast<double>(sum.stall_us) * 1e-6));
  }

  // --- time

  void Tick() {
    DropSilent();
    DropAbandoned();
    HandOut();
    for (const auto& job : std::vector(jobs_.begin(), jobs_.end())) Deliver(*job);
    SendProgress();
    if (Now() - pinged_s_ >= kHeartbeatS) {
      pinged_s_ = Now();
      for (const auto& [c, pulse] : pulses_) c->Send({MessageType::kPing, 0, {}, {}});
    }
    if (Now() - logged_s_ >= kLogEveryS) {
      logged_s_ = Now();
      LogProgress();
    }
    timer_.expires_after(kTick);
    timer_.async_wait([this](const boost::system::error_code& e) {
      if (!e) Tick();
    });
  }

  void DropSilent() {
    // A master that was itself stopped has not listened meanwhile.
    const double now_s = Now();
    const bool slept = now_s - ticked_s_ > kSilenceS / 2;
    ticked_s_ = now_s;
    std::vector<ConnectionPtr> dead;
    for (auto& [c, pulse] : pulses_) {
      if (slept || c->received_bytes() != pulse.received) pulse = {now_s, c->received_bytes()};
      if (now_s - pulse.heard_s > kSilenceS) dead.push_back(c);
    }
    for (const ConnectionPtr& c : dead) Lose(c, fmt::format("silent for {:.0f} seconds", kSilenceS));
  }

  /// Jobs whose client has gone for good, unless they are kept on disk.
  void DropAbandoned() {
    if (spool_) return;
    std::vector<std::shared_ptr<Job>> gone;
    for (const auto& job : jobs_)
      if (job->clients.empty() && Now() - job->alone_since_s > kClientGraceS) gone.push_back(job);
    for (const auto& job : gone) RemoveJob(job);
  }

  void SendProgress() {
    std::set<const Job*> told;
    if (roster_.all().empty())  // so that who waits knows why
      for (const auto& job : jobs_)
        for (const Job::Client& client : job->clients)
          client.connection->Send(
              MakeMessage(MessageType::kFrameProgress,
                          FrameProgress{job->job.first_frame + static_cast<uint32_t>(client.next), 0, 0, 0}));
    for (const Rendering& r : renderings_) {
      if (!told.insert(r.job.get()).second) continue;
      const FrameProgress progress{r.frame->job().first_frame, r.frame->tiles_done(),
                                   static_cast<uint32_t>(r.frame->frame().tiles().size()),
                                   static_cast<uint32_t>(roster_.all().size())};
      for (const Job::Client& client : r.job->clients)
        client.connection->Send(MakeMessage(MessageType::kFrameProgress, progress));
    }
  }

  const MasterOptions& options_;
  asio::io_context io_;
  FileVoxelSource source_;
  std::optional<Spool> spool_;
  std::optional<TileLog> tile_log_;
  Bytes packed_catalog_;
  std::vector<uint32_t> block_bytes_;  ///< stored, by block
  asio::steady_timer timer_;
  Clock::time_point start_;
  std::unique_ptr<Listener> listener_;
  std::set<ConnectionPtr> newcomers_;
  std::map<const Connection*, Role> roles_;
  std::map<ConnectionPtr, Pulse> pulses_;  ///< of workers and clients
  Roster roster_;
  std::deque<std::shared_ptr<Job>> jobs_;
  std::deque<Rendering> renderings_;
  std::unique_ptr<ActiveFrame> previous_;  ///< the last one finished, without its pixels
  bool handing_out_ = false;
  int encoding_ = 0;       ///< frames on their way from the last tile to Job::finished
  uint32_t failures_ = 0;  ///< workers that could not go on with the frames at hand
  uint64_t next_setup_;    ///< from a random start: results for another master's frames are known by it
  uint64_t voxel_bytes_served_ = 0;
  double ticked_s_ = 0, pinged_s_ = 0, logged_s_ = 0;
  asio::thread_pool encoder_{1};  ///< last: what it runs uses all of the above
};

}  // namespace

Status RunMaster(const MasterOptions& options) {
  for (const std::string& source : options.sources) QUARRY_TRY(ParseSource(source));
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(options.scene));
  std::optional<Spool> spool;
  if (!options.spool.empty()) {
    QUARRY_ASSIGN(spool, Spool::Open(options.spool, store.catalog().id));
  }
  std::optional<TileLog> tile_log;
  if (!options.trace.empty()) {
    QUARRY_ASSIGN(tile_log, TileLog::Create(options.trace));
  }
  Server server(options, std::move(store), std::move(spool), std::move(tile_log));
  return server.Run();
}

}  // namespace quarry

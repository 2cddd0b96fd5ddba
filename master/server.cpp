// Longer than other files: one class, that puts all others of this folder together and is tested as a whole.
#include "master/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <map>
#include <optional>
#include <random>
#include <set>
#include <unordered_map>
#include <utility>

#include "common/base/size.h"
#include "common/engine/scene.h"
#include "common/net/liveness_monitor.h"
#include "common/net/source_spec.h"
#include "common/protocol/messages.h"
#include "master/block_service.h"
#include "master/jobs/jobs.h"
#include "master/jobs/statistics.h"
#include "master/jobs/tile_log.h"
#include "master/schedule/active_frame.h"
#include "master/schedule/footprint_probe.h"
#include "master/schedule/unattributed_tile_cost.h"
#include "master/schedule/wait_budget.h"
#include "master/worker_registry.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;
using ConnectionPtr = std::shared_ptr<Connection>;

constexpr auto kTick = std::chrono::milliseconds(250);
constexpr uint64_t kMaxQueuedBytes = 256u << 20;  // a peer that does not read is dropped beyond this
constexpr double kLogEveryS = 10;
/// Of half-read messages over all connections: the largest job, and something beside it; and what workers
/// with every block name them by, for a few at once.
constexpr uint64_t kIncomingBytes = 11u << 20, kIncomingBytesPerBlock = 16;
/// For a worker that has answered none, beside others that have: what it holds nobody else makes.
constexpr uint32_t kUnprovenTiles = 4;
constexpr uint32_t kMostFailures = 3;  // workers that fail before the job is given up

/// A frame being rendered.
struct Rendering {
  Jobs::Begun part;  ///< of a job
  std::unique_ptr<ActiveFrame> frame;
  double start_s = 0;
  uint64_t bytes_served_before = 0;
};

class Server {
 public:
  Server(const MasterOptions& options, Scene scene, std::optional<Spool> spool,
         std::optional<TileLog> tile_log)
      : options_(options),
        scene_(std::move(scene)),
        source_(scene_.MakeSource([this](std::function<void()> task) { asio::post(io_, std::move(task)); })),
        tile_log_(std::move(tile_log)),
        timer_(io_),
        start_(Clock::now()),
        next_setup_((uint64_t{std::random_device{}()} << 24) + 1),
        jobs_(io_, catalog().id, std::move(spool), options.frame_memory,
              {[this] { HandOutSoon(); },
               [this](const Job& job) {
                 std::erase_if(renderings_, [&](const Rendering& r) { return r.part.job.get() == &job; });
               },
               [this](const std::string& line) { Log(line); }}) {
    packed_catalog_ = PackSections(scene_.store().catalog_sections());
    uint64_t stored = 0, decoded = 0;
    for (const VoxelEntry& voxel : catalog().voxels)
      for (const BlockEntry& block : voxel.blocks) {
        block_bytes_.push_back(block.stored);
        stored += block.stored;
        decoded += block.decoded;
      }
    if (stored > 0) decoded_per_stored_ = static_cast<double>(decoded) / static_cast<double>(stored);
  }

  Status Run() {
    if (options_.foresight_bytes > 0 && options_.policy == SchedulingPolicy::kFootprint &&
        !options_.serve_only) {
      QUARRY_ASSIGN(probe_, FootprintProbe::Create(scene_, options_.foresight_bytes,
                                                   [this] { asio::post(io_, [this] { OnForeseen(); }); }));
    }
    ListenerOptions listening;
    listening.incoming_bytes = kIncomingBytes + kIncomingBytesPerBlock * block_bytes_.size();
    listening.log = [this](const std::string& line) { Log(line); };
    QUARRY_ASSIGN(listener_, Listener::Open(
                                 io_, options_.listen, options_.security,
                                 [this](ConnectionPtr c) { OnConnection(c); }, std::move(listening)));
    fmt::print("listening {}:{}\n", options_.listen.host, listener_->port());
    std::fflush(stdout);
    jobs_.TakeUp();
    Tick();
    io_.run();
    return {};
  }

 private:
  double Now() const { return std::chrono::duration<double>(Clock::now() - start_).count(); }
  void Log(const std::string& text) const {
    if (!options_.quiet) fmt::print(stderr, "quarry-master: {}\n", text);
  }
  const Catalog& catalog() const { return scene_.catalog(); }

  // --- connections

  void OnConnection(const ConnectionPtr& c) {
    newcomers_.insert(c);
    c->Start([this, c](const Message& m) { OnAny(c, m); },
             [this, c](const Error& e) {
               newcomers_.erase(c);
               OnGone(c, e, false);
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
    c->Expect(hello.role == Role::kWorker   ? Speaker::kWorker
              : hello.role == Role::kVoxels ? Speaker::kVoxels
                                            : Speaker::kClient);
    if (hello.role != Role::kVoxels) liveness_.Add(c, Now());
    Welcome welcome{catalog().id, 0, options_.sources};
    if (hello.role == Role::kWorker) welcome.worker = AddWorker(c, hello);
    c->Send(MakeMessage(MessageType::kWelcome, welcome));
    if (hello.role == Role::kWorker)
      blocks_.Send(c, packed_catalog_.size(), [this, &connection = *c] {
        if (WorkerRecord* worker = registry_.Find(&connection)) worker->has_catalog = true;
        WorkersChanged();
        return Message{MessageType::kCatalog, 0, {}, packed_catalog_};
      });
    return {};
  }

  /// Every message after the first: by role.
  Status OnMessage(const ConnectionPtr& c, Role role, const Message& m) {
    if (c->queued_bytes() > kMaxQueuedBytes) return Lose(c, "it does not read what it asked for"), Status{};
    if (m.type == MessageType::kPing) return {};
    if (role == Role::kVoxels && m.type == MessageType::kBlockRequest) return blocks_.Answer(c, m);
    if (role == Role::kClient && m.type == MessageType::kRenderJob) {
      QUARRY_ASSIGN(JobRequest request, DecodeJobRequest(m.table));
      return jobs_.Ask(c, std::move(request));
    }
    WorkerRecord* worker = role == Role::kWorker ? registry_.Find(c.get()) : nullptr;
    if (worker && m.type == MessageType::kTileDone) return OnTileDone(*worker, m);
    if (worker && m.type == MessageType::kFailure) return OnWorkerFailure(*worker, m);
    if (worker && m.type == MessageType::kHello) return OnServesAt(*worker, m);
    if (worker && m.type == MessageType::kWorkerStatus) {
      QUARRY_ASSIGN(const WorkerStatus alive, DecodeWorkerStatus(m.table));
      QUARRY_TRY(CheckBlocks(alive.cached));
      QUARRY_TRY(CheckBlocks(alive.dropped));
      WorkerRegistry::Update(*worker, alive);
      if (alive.whole) {  // it has the scene now, or has come back with its cache
        worker->has_scene = true;
        WorkersChanged();
      }
      return {};
    }
    return Fail(fmt::format("a message of type {} does not belong here", static_cast<int>(m.type)));
  }

  /// `dropped`: by this master. A client that has its pictures and goes, and one that only read voxels, have
  /// ended well.
  void OnGone(const ConnectionPtr& c, const Error& error, bool dropped = true) {
    const auto role = roles_.find(c.get());
    const bool ended_well = !dropped && role != roles_.end();
    const bool was_client = ended_well && role->second == Role::kClient;
    roles_.erase(c.get());
    liveness_.Forget(c);
    blocks_.Forget(c);
    if (const WorkerRecord* worker = registry_.Find(c.get())) {
      const uint32_t id = worker->id;
      Log(fmt::format("worker {} is gone: {}", worker->name, error.message));
      registry_.Remove(c.get());
      for (Rendering& r : renderings_) r.frame->Forget(id);
      WorkersChanged();
      return;
    }
    const bool waited = jobs_.ForgetClient(c, Now());
    if (waited)
      Log(fmt::format("client {} is gone before its pictures were done: {}", c->peer(), error.message));
    else if (!ended_well)
      Log(error.message);
    else if (was_client)
      Log(fmt::format("client {} has ended", c->peer()));
  }

  // --- workers and tiles

  /// Sets of blocks are as large as the largest number in them.
  Status CheckBlocks(const std::vector<uint32_t>& blocks) const {
    if (blocks.size() > block_bytes_.size())
      return Fail(fmt::format("{} blocks are named: there are {}", blocks.size(), block_bytes_.size()));
    for (const uint32_t block : blocks)
      if (block >= block_bytes_.size()) return Fail(fmt::format("block {}: there is none", block));
    return {};
  }

  uint32_t AddWorker(const ConnectionPtr& c, const Hello& hello) {
    // The same worker on a connection that is not yet known to be lost.
    if (const WorkerRecord* old = registry_.FindInstance(hello.instance)) {
      const ConnectionPtr lost = old->connection;
      Refuse(lost, "you are here a second time");
    }
    const WorkerRecord& worker = registry_.Add(c, hello);
    Log(fmt::format("worker {} has joined with {} threads", worker.name, worker.threads));
    return worker.id;
  }

  /// A worker says at which port it serves others.
  Status OnServesAt(WorkerRecord& worker, const Message& m) {
    QUARRY_ASSIGN(const Hello hello, DecodeHello(m.table));
    worker.SetServesAt(hello.serves_at);
    return {};
  }

  /// Once for all that come or go at the same time, for plans take their time.
  void WorkersChanged() {
    workers_changed_ = true;
    HandOutSoon();
  }

  void TellAndPlan() {
    const Peers peers = registry_.MakePeers();
    for (auto& [id, worker] : registry_.all())
      if (worker.has_scene) worker.connection->Send(MakeMessage(MessageType::kPeers, peers));
    MakePlans(PlanNews::kWorkers);
  }

  std::vector<ActiveFrame*> Frames() const {
    std::vector<ActiveFrame*> frames;
    for (const Rendering& r : renderings_) frames.push_back(r.frame.get());
    return frames;
  }

  /// Has those under way foreseen, and those that come next, so that they are when they begin.
  void AskForesight() {
    constexpr size_t kAhead = 3, kMostTiles = 4096;
    std::vector<FootprintProbe::Wish> wishes;
    const auto add = [&](const Jobs::Begun& frame) {
      const uint64_t pixels = uint64_t{frame.one.crop_width} * frame.one.crop_height;
      if (pixels <= kMostTiles * kTileSize * kTileSize)
        wishes.push_back({frame.job->id, frame.index, frame.one});
    };
    // One worker gets all tiles, whatever they touch.
    if (registry_.all().size() > 1) {
      for (const Rendering& r : renderings_)
        if (!r.frame->learned() && r.frame->open_tiles() > 0) add(r.part);
      for (const Jobs::Begun& next : jobs_.Upcoming(kAhead)) add(next);
    }
    probe_->Want(std::move(wishes));
    for (Rendering& r : renderings_)
      if (!r.frame->learned())
        if (auto coarse = probe_->Find(r.part.job->id, r.part.index)) r.frame->Learn(std::move(coarse));
  }

  bool IsNextBeingForeseen() const {
    const auto next = jobs_.Upcoming(1);
    return probe_ && !next.empty() && probe_->IsAtWork(next[0].job->id, next[0].index);
  }

  /// Whether the next frame is to be foreseen before it begins, though a worker has nothing to do.
  bool IsWorthWaiting() {
    if (!probe_) return false;
    if (renderings_.empty()) AskForesight();
    return wait_budget_.Waits(Now(), IsNextBeingForeseen());
  }

  /// Frames that begin later take it up by themselves.
  void OnForeseen() {
    HandOutSoon();
    const bool now = std::ranges::any_of(renderings_, [this](const Rendering& r) {
      return !r.frame->learned() && probe_->Find(r.part.job->id, r.part.index);
    });
    if (now) MakePlans(PlanNews::kFrames);
  }

  /// Of all frames under way: whenever one begins or ends, and when workers come and go.
  void MakePlans(PlanNews news) {
    if (probe_) AskForesight();
    std::map<uint32_t, double> speeds;
    std::map<uint32_t, BlockSet> holds;
    const auto sound = [](const auto& entry) {
      return entry.second.has_catalog && !entry.second.conduct.doubtful();
    };
    const bool any_sound = std::ranges::any_of(registry_.all(), sound);
    for (const auto& entry : registry_.all()) {
      const WorkerRecord& worker = entry.second;
      if (any_sound ? !sound(entry) : !worker.has_catalog) continue;
      speeds[worker.id] = worker.threads;
      holds[worker.id] = worker.holds;
    }
    overhead_.Decoded(registry_.DecodeSeconds());
    PlanFrames(Frames(), previous_.get(), news, speeds, std::move(holds),
               {block_bytes_, registry_.SecondsPerByte(decoded_per_stored_), overhead_.seconds()},
               options_.policy);
  }

  /// Once for all the messages at hand.
  void HandOutSoon() {
    if (std::exchange(handing_out_, true)) return;
    asio::post(io_, [this] {
      handing_out_ = false;
      AssignTiles();
    });
  }

  void AssignTiles() {
    if (std::exchange(workers_changed_, false)) TellAndPlan();
    LookAtConduct();
    const bool any_proven = registry_.AnyProven();
    std::vector<WorkerCredit> hands;
    for (const auto& [id, worker] : registry_.all())
      if (worker.has_catalog)
        hands.push_back(
            {id,
             any_proven && worker.tiles == 0 ? std::min(kUnprovenTiles, worker.Credit()) : worker.Credit(),
             worker.threads, worker.conduct.quiet_s()});
    const bool ending = jobs_.Upcoming(1).empty();
    std::function<double(const ActiveFrame&, uint32_t, uint32_t)> fetch_s;
    if (options_.policy == SchedulingPolicy::kFootprint)
      fetch_s = [this, per_byte = registry_.SecondsPerByte(decoded_per_stored_)](
                    const ActiveFrame& frame, uint32_t tile, uint32_t worker) {
        return ExpectedBytes(frame.Expected(tile), registry_.FindById(worker)->holds, block_bytes_) *
               per_byte;
      };
    for (AssignedTile& tile : quarry::AssignTiles(Frames(), hands, Now(), ending, fetch_s, [this] {
           return MayBegin(Frames()) && !IsWorthWaiting() ? StartFrame() : nullptr;
         })) {
      WorkerRecord& worker = *registry_.FindById(tile.worker);
      const uint64_t setup = tile.order.setup, oldest = renderings_.front().frame->setup();
      if (worker.setups.insert(setup).second) {
        worker.connection->Send(
            MakeMessage(MessageType::kFrameSetup, FrameSetup{setup, tile.frame->job(), oldest}));
        worker.setups.erase(worker.setups.begin(), worker.setups.lower_bound(oldest));
      }
      AddHints(tile, worker);
      worker.connection->Send(MakeMessage(MessageType::kTile, tile.order));
    }
    overhead_.Busy(Now(), LookAtConduct());
  }

  /// Notes who holds tiles, and returns how many threads have one.
  uint32_t LookAtConduct() {
    std::unordered_map<uint32_t, uint32_t> held;
    for (const Rendering& r : renderings_) r.frame->AddHeld(held);
    uint32_t busy = 0;
    for (auto& [id, worker] : registry_.all()) {
      const auto it = held.find(id);
      worker.conduct.Look(Now(), it != held.end());
      if (it != held.end()) busy += std::min(it->second, worker.threads);
    }
    return busy;
  }

  /// Others have finished tiles that these workers hold.
  void NoteOutdone(const ActiveFrame& frame) {
    std::set<uint32_t> outdone;
    frame.AddOutdone(outdone);
    for (const uint32_t id : outdone)
      if (WorkerRecord* worker = registry_.FindById(id)) worker->conduct.Outdone();
  }

  void DropMute() {
    std::vector<ConnectionPtr> mute;
    for (const auto& [id, worker] : registry_.all())
      if (worker.conduct.mute()) mute.push_back(worker.connection);
    for (const ConnectionPtr& c : mute)
      Lose(c, fmt::format("it has answered nothing for {:.0f} s in which it held tiles, and others have "
                          "finished those",
                          Conduct::kMuteS));
  }

  /// What the tile is expected to touch and the worker lacks.
  void AddHints(AssignedTile& tile, const WorkerRecord& worker) const {
    const TileTrace& expected = tile.frame->Expected(tile.order.tile);
    for (size_t i = 0; i < expected.blocks.size() && tile.order.blocks.size() < kMaxTileHints; ++i) {
      const uint32_t block = expected.blocks[i];
      if (expected.chances[i] < kHintChance || worker.holds.Has(block)) continue;
      tile.order.blocks.push_back(block);
      tile.order.holders.push_back(registry_.HolderOf(block, worker.id));
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
      worker.conduct.Answered(kept);
      if (kept) overhead_.Done(r.frame->ShownCost(done.tile));
      if (kept && tile_log_) tile_log_->Tile(*r.frame, done, worker.name);
      if (r.frame->done()) FinishFrame(done.setup);
      return {};
    }
    worker.conduct.Answered(false);
    return {};  // of a frame that is over
  }

  /// A worker cannot begin, which is its own matter, or cannot get a block. Others may; when none is left, or
  /// several that have answered tiles have said so, the job cannot be done.
  Status OnWorkerFailure(const WorkerRecord& worker, const Message& m) {
    QUARRY_ASSIGN(const Failure failure, DecodeFailure(m.table));
    failures_ += worker.tiles > 0;
    if (worker.has_scene && !renderings_.empty() &&
        (failures_ >= kMostFailures || registry_.all().size() == 1))
      jobs_.Fail(
          renderings_.front().part.job,
          fmt::format("worker {} cannot get voxels: {}; its --source, or the master's, says where they are",
                      worker.name, failure.message));
    Log(fmt::format("worker {} gives up: {}", worker.name, failure.message));
    return Fail(failure.message);
  }

  // --- frames

  /// The next frame, planned with those under way. Null when there is none.
  ActiveFrame* StartFrame() {
    auto part = jobs_.Begin();
    if (!part) return nullptr;
    const ActiveFrame* before = renderings_.empty() ? previous_.get() : renderings_.back().frame.get();
    auto frame = std::make_unique<ActiveFrame>(next_setup_++, part->one, before);
    if (tile_log_) tile_log_->Frame(*frame);
    failures_ = 0;
    renderings_.push_back({std::move(*part), std::move(frame), Now(), blocks_.bytes_served()});
    MakePlans(PlanNews::kFrames);
    return renderings_.back().frame.get();
  }

  void FinishFrame(uint64_t setup) {
    const auto it = std::find_if(renderings_.begin(), renderings_.end(),
                                 [&](const Rendering& r) { return r.frame->setup() == setup; });
    Rendering done = std::move(*it);
    renderings_.erase(it);
    NoteOutdone(*done.frame);
    const FrameTimes times{done.start_s, Now(), blocks_.bytes_served() - done.bytes_served_before};
    jobs_.Finish(std::move(done.part), done.frame->TakePixels(),
                 FrameStatistics(*done.frame, times, registry_));
    previous_ = std::move(done.frame);
    overhead_.Fade();
    // Where another begins, that plans them all. Nobody idles yet: what is being foreseen can wait.
    const bool begins = MayBegin(Frames()) && !IsNextBeingForeseen() && StartFrame();
    if (!begins) MakePlans(PlanNews::kFrames);
    HandOutSoon();
  }

  // --- time

  void Tick() {
    for (const ConnectionPtr& c : liveness_.Silent(Now()))
      Lose(c, fmt::format("silent for {:.0f} seconds", kSilenceS));
    for (const ConnectionPtr& c : blocks_.Stalled()) Lose(c, "it does not read what it asked for");
    for (const Rendering& r : renderings_) NoteOutdone(*r.frame);
    DropMute();
    jobs_.DropAbandoned(Now());
    AssignTiles();
    jobs_.Deliver();
    SendProgress();
    liveness_.Beat(Now());
    if (Now() - logged_s_ >= kLogEveryS) {
      logged_s_ = Now();
      if (!renderings_.empty()) Log(ProgressLine(*renderings_.front().frame, registry_));
    }
    timer_.expires_after(kTick);
    timer_.async_wait([this](const boost::system::error_code& e) {
      if (!e) Tick();
    });
  }

  void SendProgress() {
    std::set<const Job*> told;
    if (registry_.all().empty())  // so that who waits knows why
      for (const auto& job : jobs_.all())
        for (const Job::Client& client : job->clients)
          client.connection->Send(
              MakeMessage(MessageType::kFrameProgress,
                          FrameProgress{job->job.first_frame + static_cast<uint32_t>(client.next), 0, 0, 0}));
    for (const Rendering& r : renderings_) {
      if (!told.insert(r.part.job.get()).second) continue;
      const FrameProgress progress{r.frame->job().first_frame, r.frame->tiles_done(),
                                   static_cast<uint32_t>(r.frame->frame().tiles().size()),
                                   static_cast<uint32_t>(registry_.all().size())};
      for (const Job::Client& client : r.part.job->clients)
        client.connection->Send(MakeMessage(MessageType::kFrameProgress, progress));
    }
  }

  const MasterOptions& options_;
  asio::io_context io_;
  const Scene scene_;
  const std::unique_ptr<VoxelSource> source_;
  BlockService blocks_{*source_,
                       [this](uint32_t b) { return b < block_bytes_.size() ? block_bytes_[b] : 0; }};
  std::optional<TileLog> tile_log_;
  Bytes packed_catalog_;
  std::vector<uint32_t> block_bytes_;  ///< stored, by block
  double decoded_per_stored_ = 1;      ///< bytes, of all blocks
  asio::steady_timer timer_;
  Clock::time_point start_;
  std::unique_ptr<Listener> listener_;
  std::set<ConnectionPtr> newcomers_;
  std::map<const Connection*, Role> roles_;
  LivenessMonitor liveness_;  ///< of workers and clients
  WorkerRegistry registry_;
  UnattributedTileCost overhead_;
  std::deque<Rendering> renderings_;
  std::unique_ptr<ActiveFrame> previous_;  ///< the last one finished, without its pixels
  bool handing_out_ = false;               ///< it is about to
  bool workers_changed_ = false;           ///< and neither plans nor workers know
  uint32_t failures_ = 0;                  ///< workers that could not go on with the frames at hand
  uint64_t next_setup_;  ///< from a random start: results for another master's frames are known by it
  double logged_s_ = 0;
  WaitBudget wait_budget_;
  Jobs jobs_;                              ///< it tells of all of the above
  std::unique_ptr<FootprintProbe> probe_;  ///< last: its thread tells too; null: there is none
};

}  // namespace

Status RunMaster(const MasterOptions& options) {
  for (const std::string& source : options.sources) QUARRY_TRY(ParseSource(source));
  QUARRY_ASSIGN(const Scene scene, Scene::Open(options.scene));
  std::optional<Spool> spool;
  if (!options.spool.empty()) {
    QUARRY_ASSIGN(spool, Spool::Open(options.spool, scene.catalog().id));
  }
  std::optional<TileLog> tile_log;
  if (!options.trace.empty()) {
    QUARRY_ASSIGN(tile_log, TileLog::Create(options.trace));
  }
  const uint32_t largest = scene.catalog().meta.largest_decoded;
  if (options.foresight_bytes > 0 && options.foresight_bytes < largest)
    return BadUsage(fmt::format(
        "--foresight of {} is less than the scene's largest block, {} bytes; give at least that, or 0",
        FormatSize(options.foresight_bytes), largest));
  Server server(options, scene, std::move(spool), std::move(tile_log));
  return server.Run();
}

}  // namespace quarry

#include "master/server.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cstdio>
#include <functional>
#include <optional>
#include <random>
#include <utility>

#include "common/base/log.h"
#include "common/base/size.h"
#include "common/engine/integrators/path/light_range.h"
#include "common/net/source_spec.h"
#include "common/program/service_notice.h"
#include "common/remote/open_store.h"
#include "master/jobs/statistics.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

/// Time between looks at silent peers, stragglers and progress.
constexpr auto kTick = std::chrono::milliseconds(250);
/// Bytes queued for a peer that does not read; beyond this it is dropped.
constexpr uint64_t kMaxQueuedBytes = 256u << 20;
/// Seconds between two lines of progress in the log.
constexpr double kLogEveryS = 10;
/// Bytes of half-read messages over all connections: the largest job and a margin, and for each block its
/// mention in the status of a few workers that hold every block.
constexpr uint64_t kIncomingBytes = 11u << 20, kIncomingBytesPerBlock = 16;

/// From a random start: results for another master's frames are recognised.
FrameId RandomStart() { return uint64_t{std::random_device{}()} << 24; }

std::vector<uint32_t> StoredBytes(const Catalog& catalog) {
  std::vector<uint32_t> bytes;
  for (uint32_t number = 0; number < catalog.block_numbers(); ++number) {
    const std::optional<BlockKey> block = catalog.BlockOf(number);
    bytes.push_back(block ? catalog.block(*block).stored : 0);
  }
  return bytes;
}

}  // namespace

Server::Server(asio::io_context& io, const MasterOptions& options, Scene scene,
               const std::vector<Scene>& environments, std::optional<Spool> spool,
               std::optional<TileLog> tile_log)
    : io_(io),
      options_(options),
      scene_(std::move(scene)),
      source_(scene_.MakeSource([&io](std::function<void()> task) { asio::post(io, std::move(task)); })),
      block_bytes_(StoredBytes(catalog())),
      blocks_(*source_, catalog()),
      environments_(io, environments),
      packed_catalog_(PackSections(scene_.store().catalog_sections())),
      selections_(scene_.store()),
      orders_(registry_),
      meter_(orders_, catalog().materials, kFirstMeterFrame | RandomStart()),
      jobs_(io, {catalog().id, catalog().meta.offset}, std::move(spool), options.frame_memory,
            {[this] { AssignSoon(); },
             [this](const Job& job) {
               meter_.End(job.id);
               for (const FrameId id : frames_.Forget(job)) dispatcher_.Cancel(id);
             },
             [this](const std::string& line) { Log(line); },
             [this](const Job& job, JobMeter::Done done) {
               meter_.Begin(job.id, FrameView(job.job), std::move(done));
               AssignSoon();
             },
             [this](View& view) -> Status {
               QUARRY_TRY(environments_.Complete(view));
               FitLight(view, catalog(), environments_.TableOf(view));
               return selections_.Complete(view);
             }}),
      frames_(
          jobs_, registry_, [this] { return blocks_.bytes_served(); }, std::move(tile_log)),
      dispatcher_(frames_, block_bytes_, options.policy, RandomStart() + 1),
      queries_(io, scene_,
               [this] {
                 return status_.Json(catalog().id, Now(), registry_, jobs_,
                                     frames_.PartsDone(dispatcher_.Frames()));
               }),
      leaving_(io) {
  uint64_t stored = 0;
  for (const uint32_t bytes : block_bytes_) stored += bytes;
  if (stored > 0)
    decoded_per_stored_ = static_cast<double>(catalog().DecodedBytes()) / static_cast<double>(stored);
  UpdateCosts();
}

Status Server::Run() {
  if (options_.foresight_bytes > 0 && options_.policy == SchedulingPolicy::kFootprint && !options_.serve_only)
    QUARRY_TRY(frames_.StartProbe(scene_, options_.foresight_bytes,
                                  [this] { asio::post(io_, [this] { OnProbed(); }); }));
  ListenerOptions listening;
  listening.incoming_bytes = kIncomingBytes + kIncomingBytesPerBlock * block_bytes_.size();
  listening.log = [this](const std::string& line) { Log(line); };
  QUARRY_ASSIGN(listener_, Listener::Open(
                               io_, options_.listen, options_.security,
                               [this](ConnectionPtr c) { OnConnection(c); }, std::move(listening)));
  if (options_.display) {
    QUARRY_ASSIGN(display_,
                  Display::Open(io_, *options_.display, scene_, selections_, environments_, registry_,
                                queries_, ForViewers(), [this](const std::string& line) { Log(line); }));
    Print(fmt::format("viewing {}\n", display_->url()));
  }
  Print(fmt::format("listening {}\n", TextOf({options_.listen.host, listener_->port()})));
  // For programs: the address of the pages on this machine, which a proxy's URL does not show.
  if (display_) Print(fmt::format("serving {}\n", TextOf({options_.display->listen.host, display_->port()})));
  FlushOutput();
  if (!options_.spool.empty()) termination_ = Termination::Take(io_, [this] { StartLeaving(); });
  NotifyReady(fmt::format("listening at {}:{}", options_.listen.host, listener_->port()));
  jobs_.TakeUp();
  asio::steady_timer timer(io_);
  const std::function<void()> tick = [&] {
    Tick();
    timer.expires_after(kTick);
    timer.async_wait([&](const boost::system::error_code& e) {
      if (!e) tick();
    });
  };
  tick();
  io_.run();
  return {};
}

/// The service that renders the pictures that viewers save.
SavedPictures::JobService Server::ForViewers() {
  return {[this](const ConnectionPtr& c, JobRequest request) -> Status {
            QUARRY_TRY(environments_.Complete(request.job.view));
            return jobs_.Ask(c, std::move(request));
          },
          // A viewer does not come back for a picture: its job need not wait for it.
          [this](const ConnectionPtr& c) { jobs_.ForgetClient(c, -1e9); },
          [this](uint64_t bytes) { return jobs_.Hold(bytes); }};
}

double Server::Now() const {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
}

void Server::Log(const std::string& text) const {
  if (!options_.quiet) quarry::Log(fmt::format("quarry-master: {}", text));
}

// --- Connections

void Server::OnConnection(const ConnectionPtr& c) {
  newcomers_.insert(c);
  c->Start([this, c](const Message& m) { OnFirstOrLater(c, m); },
           [this, c](const Error& e) { OnGone(c, e, false); });
}

void Server::Refuse(const ConnectionPtr& c, const std::string& sentence) {
  c->Send(MakeMessage(MessageType::kFailure, Failure{sentence}));
  Lose(c, sentence);
}

/// The peer gets no sentence: it may connect again.
void Server::Lose(const ConnectionPtr& c, const std::string& why) {
  c->Close();
  OnGone(c, Error{fmt::format("{} is dropped: {}", c->peer(), why)}, true);
}

void Server::OnFirstOrLater(const ConnectionPtr& c, const Message& m) {
  const auto role = roles_.find(c.get());
  const Status status = role != roles_.end() ? OnMessage(c, role->second, m) : OnHello(c, m);
  if (!status) Refuse(c, status.error().message);
}

Status Server::OnHello(const ConnectionPtr& c, const Message& m) {
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
  Welcome welcome{catalog().id, 0, options_.sources, environments_.largest_bytes()};
  if (environments_.Greet(c, hello.store)) welcome.scene_id = hello.store;
  if (hello.role == Role::kWorker) welcome.worker = AddWorker(c, hello);
  c->Send(MakeMessage(MessageType::kWelcome, welcome));
  if (hello.role == Role::kWorker)
    blocks_.Send(c, packed_catalog_.size(), [this, &connection = *c] {
      if (WorkerRecord* worker = registry_.Find(&connection)) {
        worker->ready = true;
        if (display_) display_->WorkerReady(*worker);
      }
      WorkersChanged();
      return Message{MessageType::kCatalog, 0, {}, packed_catalog_};
    });
  return {};
}

/// Every message after the first: by role.
Status Server::OnMessage(const ConnectionPtr& c, Role role, const Message& m) {
  if (c->queued_bytes() > kMaxQueuedBytes)
    return Lose(c, "it does not read the answers to its requests"), Status{};
  if (m.type == MessageType::kPing) return {};
  if (role == Role::kVoxels && m.type == MessageType::kBlockRequest) {
    BlockService* const of_environment = environments_.ServiceOf(c);
    return (of_environment ? *of_environment : blocks_).Answer(c, m);
  }
  if (role == Role::kClient && m.type == MessageType::kRenderJob) {
    QUARRY_ASSIGN(JobRequest request, DecodeJobRequest(m.table));
    QUARRY_TRY(environments_.Complete(request.job.view));  // the environment is a part of the job's name
    return jobs_.Ask(c, std::move(request));
  }
  if (role == Role::kClient && m.type == MessageType::kQuery) {
    QUARRY_ASSIGN(const Query query, DecodeQuery(m.table));
    queries_.Answer(c, query);
    return {};
  }
  if (WorkerRecord* worker = role == Role::kWorker ? registry_.Find(c.get()) : nullptr)
    return OnWorkerMessage(*worker, m);
  return Fail(fmt::format("a message of type {} is not allowed here", static_cast<int>(m.type)));
}

/// `dropped`: by this master. A client that has its pictures and goes, and a reader of voxels, end well.
void Server::OnGone(const ConnectionPtr& c, const Error& error, bool dropped) {
  newcomers_.erase(c);
  const auto role = roles_.find(c.get());
  const bool ended_well = !dropped && role != roles_.end();
  const bool was_client = ended_well && role->second == Role::kClient;
  roles_.erase(c.get());
  liveness_.Forget(c);
  blocks_.Forget(c);
  environments_.Forget(c);
  if (const WorkerRecord* worker = registry_.Find(c.get())) {
    Log(fmt::format("worker {} is gone: {}", worker->name, error.message));
    const uint32_t id = worker->id;
    const std::string lost =
        worker->ready ? fmt::format("Worker {} is gone: {}.", worker->name, error.message) : "";
    dispatcher_.RemoveWorker(id);
    registry_.Remove(c.get());
    meter_.RemoveWorker(id);
    if (display_) display_->WorkerGone(id, lost);
    UpdateCosts();
    WorkersChanged();
    return;
  }
  if (jobs_.ForgetClient(c, Now()))
    Log(fmt::format("client {} left before its pictures were done: {}", c->peer(), error.message));
  else if (!ended_well)
    Log(error.message);
  else if (was_client)
    Log(fmt::format("client {} has ended", c->peer()));
}

// --- Tiles and time

/// A frame that begins later learns of its probe when it begins.
void Server::OnProbed() {
  AssignSoon();
  if (frames_.HasNews(dispatcher_.Frames())) dispatcher_.PlanForProbes();
}

/// Plans and peers follow once for all workers that come or go at the same time.
void Server::WorkersChanged() {
  workers_changed_ = true;
  AssignSoon();
}

/// Once for all messages that have arrived.
void Server::AssignSoon() {
  if (std::exchange(assigning_, true)) return;
  asio::post(io_, [this] {
    assigning_ = false;
    AssignTiles();
  });
}

void Server::AssignTiles() {
  meter_.Assign(registry_.Proven(), Now());
  if (leaves_) return;
  if (std::exchange(workers_changed_, false)) {
    SendPeers();
    dispatcher_.PlanForWorkers();
  }
  auto tiles = dispatcher_.AssignTiles(Now());
  if (tiles.empty()) return;
  const FrameId oldest = dispatcher_.Frames().front()->id();
  for (AssignedTile& tile : tiles) SendTile(tile, oldest);
}

/// With the frame's setup, if it is the worker's first tile of the frame.
void Server::SendTile(AssignedTile& tile, FrameId oldest) {
  WorkerRecord& worker = *registry_.FindById(tile.worker);
  const FrameId id = tile.frame->id();
  if (worker.frames_told.insert(id).second) {
    worker.TellNeedsOf(tile.frame->view());
    worker.connection->Send(
        MakeMessage(MessageType::kFrameSetup, FrameSetup{id, tile.frame->view(), oldest}));
    worker.frames_told.erase(worker.frames_told.begin(), worker.frames_told.lower_bound(oldest));
  }
  for (const uint32_t block : tile.order.blocks)
    tile.order.holders.push_back(registry_.HolderOf(block, worker.id));
  worker.connection->Send(MakeMessage(MessageType::kTile, tile.order));
}

/// Ends well: rendered frames go to the spool first, if the disk takes them soon.
void Server::StartLeaving() {
  constexpr double kSpoolS = 5;
  Log("ends; its jobs and finished frames are kept in the spool");
  leaves_ = true;
  jobs_.Rest([this] { Farewell(); });
  leaving_.Set(kSpoolS, [this] { Farewell(); });
}

void Server::Farewell() {
  if (std::exchange(said_farewell_, true)) return;
  const Failure words{"it was stopped, and continues its jobs when it is started again"};
  std::vector<ConnectionPtr> peers;
  for (const auto& [id, worker] : registry_.all()) peers.push_back(worker.connection);
  for (const auto& job : jobs_.all())
    for (const Job::Client& client : job->clients) peers.push_back(client.connection);
  for (const ConnectionPtr& c : peers) {
    c->Send(MakeMessage(MessageType::kFarewell, words));
    c->Close();
  }
  AwaitSent(std::move(peers), Now());
}

/// Ends once the peers have taken all messages sent to them, frames included, or do not take them in time.
void Server::AwaitSent(std::vector<ConnectionPtr> peers, double since_s) {
  constexpr double kOftenS = 0.05, kLeastS = 0.3, kMostS = 5;
  const auto waits = [](const ConnectionPtr& c) { return c->queued_bytes() > 0; };
  const double waited_s = Now() - since_s;
  if (waited_s > kMostS || (waited_s > kLeastS && std::ranges::none_of(peers, waits))) return io_.stop();
  leaving_.Set(kOftenS,
               [this, peers = std::move(peers), since_s]() mutable { AwaitSent(std::move(peers), since_s); });
}

void Server::Tick() {
  for (const ConnectionPtr& c : liveness_.Silent(Now()))
    Lose(c, fmt::format("silent for {:.0f} seconds", kSilenceS));
  for (const ConnectionPtr& c : blocks_.Stalled()) Lose(c, "it does not read the answers to its requests");
  for (const ConnectionPtr& c : environments_.Stalled())
    Lose(c, "it does not read the answers to its requests");
  for (const uint32_t id : dispatcher_.MuteWorkers()) {
    const ConnectionPtr mute = registry_.FindById(id)->connection;
    Lose(mute, fmt::format("it has answered nothing for {:.0f} s, while others finished tiles that it held",
                           Responsiveness::kMuteS));
  }
  jobs_.DropAbandoned(Now());
  AssignTiles();
  jobs_.Deliver();
  const auto frames = dispatcher_.Frames();
  frames_.SendProgress(frames);
  liveness_.Beat(Now());
  status_.Sample(Now(), registry_, blocks_.bytes_served());
  if (display_) display_->Tick();
  if (Now() - logged_s_ < kLogEveryS) return;
  logged_s_ = Now();
  if (!frames.empty()) Log(ProgressLine(*frames.front(), frames_.NumberOf(frames.front()->id()), registry_));
}

Status RunMaster(const MasterOptions& options) {
  for (const std::string& source : options.sources) QUARRY_TRY(ParseSource(source));
  QUARRY_ASSIGN(StoreReader store, OpenStore(options.scene, options.http));
  QUARRY_TRY(CheckIsScene(store));
  const Scene scene(std::make_shared<const StoreReader>(std::move(store)));
  QUARRY_ASSIGN(const std::vector<Scene> environments,
                Environments::Open(options.environments, options.http));
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
  asio::io_context io;
  Server server(io, options, scene, environments, std::move(spool), std::move(tile_log));
  return server.Run();
}

}  // namespace quarry

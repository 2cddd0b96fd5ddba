#include "worker/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <random>
#include <utility>

#include "common/base/log.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/program/service_notice.h"

namespace quarry {
namespace {

namespace asio = boost::asio;

constexpr double kIdleS = 10;    // time without a new tile after which a log line says that the worker waits
constexpr double kRetryS = 0.3;  // pause between attempts to reach the master
constexpr double kLastWordsS = 10;  // limit for the master to close the connection after a worker's Failure

uint64_t NewInstance() {
  std::random_device random;
  return uint64_t{random()} << 32 | random() | 1;
}

/// Decoded bytes of the largest block of a scene, or of a page of an environment if there is one.
uint32_t LargestOf(const Catalog& scene, uint64_t environment_bytes) {
  constexpr uint32_t kTexelBytes = 6;
  const uint32_t page = environment_bytes > 0 ? PageRoom(kPageSide * kPageSide * kTexelBytes) : 0;
  return std::max(scene.meta.largest_decoded, page);
}

}  // namespace

/// The largest environment counts as a part of the scene.
Session::LoadedScene::LoadedScene(Catalog scene, uint64_t cache_bytes, uint64_t environment_bytes)
    : catalog(std::move(scene)),
      stored_bytes(StoredCache::ShareOf(cache_bytes, catalog.DecodedBytes() + environment_bytes,
                                        LargestOf(catalog, environment_bytes))) {}

Session::Session(const WorkerOptions& options)
    : options_(options),
      io_(std::make_unique<asio::io_context>()),
      retry_(*io_),
      heartbeat_(*io_),
      leaving_(*io_),
      instance_(NewInstance()) {}

Session::~Session() = default;

Status Session::Run() {
  if (options_.pretouch) {
    auto memory = PageBuffer::TryGet(options_.cache_bytes);
    if (!memory)
      return BadUsage(fmt::format("--pretouch: the system has no {} of memory for --cache",
                                  FormatSize(options_.cache_bytes)));
    memory_ = std::move(*memory);
    Log(fmt::format("has {} of memory", FormatSize(options_.cache_bytes)));
  }
  if (options_.metrics) {
    QUARRY_ASSIGN(metrics_, ServeMetrics(*io_, *options_.metrics, [this] { return Counters(); }));
    Log(fmt::format("serves metrics at {}:{}", options_.metrics->listen.host, metrics_->port()));
  }
  lost_since_ = Clock::now();
  termination_ = Termination::Take(*io_, [this] { StartLeaving(); });
  Join();
  Heartbeat();
  io_->run();
  return outcome_;
}

void Session::End(Status outcome) {
  outcome_ = std::move(outcome);
  io_->stop();
}

void Session::Log(const std::string& text) const {
  if (!options_.quiet) quarry::Log(fmt::format("quarry-worker: {}: {}", options_.name, text));
}

void Session::Join() {
  Connect(*io_, options_.master, options_.security, [this](Result<std::shared_ptr<Connection>> result) {
    if (!result) return OnLost(result.error());
    connection_ = std::move(*result);
    // Messages of an abandoned connection that arrive late are ignored.
    const Connection* const mine = connection_.get();
    connection_->Expect(Speaker::kMasterOfWorkers);
    connection_->Start(
        [this, mine](Message m) {
          if (mine == connection_.get()) OnMessage(std::move(m));
        },
        [this, mine](const Error& e) {
          if (mine == connection_.get()) OnLost(e);
        });
    liveness_.Add(connection_, Now());
    SendHello();
  });
}

void Session::SendHello() {
  const uint16_t serves_at = scene_ ? scene_->supply->serves_at() : uint16_t{0};
  connection_->Send(
      MakeMessage(MessageType::kHello, Hello{Role::kWorker, options_.name, options_.threads, instance_,
                                             serves_at, scene_ ? std::string() : options_.previous_end}));
}

void Session::OnLost(const Error& error) {
  if (gives_up_) return End(tl::unexpected<Error>(*gives_up_));
  if (leaves_) return End({});
  if (connection_) {
    connection_->Close();
    liveness_.Forget(connection_);
  }
  connection_.reset();
  if (std::exchange(welcomed_, false)) {
    lost_since_ = Clock::now();
    Log(fmt::format("lost the master, retrying for {:.0f} s: {}", options_.retry_s, error.message));
  }
  if (scene_) {
    scene_->renderer->DropViews(0, ~uint64_t{0});
    scene_->supply->ClearExpected();
  }
  // Secret and version fit a master that has welcomed this worker before; a later mismatch is damage on the
  // way and is retried.
  if (error.permanent() && !was_welcomed_) return End(tl::unexpected<Error>(error));
  if (SecondsSince(lost_since_) > options_.retry_s) return End(tl::unexpected<Error>(error));
  retry_.Set(kRetryS, [this] { Join(); });
}

/// Sends a sign of life and checks the master's.
void Session::Heartbeat() {
  SendStatus(false);
  if (at_work_ && SecondsSince(last_tile_) > kIdleS) {
    at_work_ = false;
    Log(fmt::format("waits for work; {} tiles so far", tiles_));
  }
  if (connection_ && !scene_) connection_->Send({MessageType::kPing, 0, {}, {}});
  if (!liveness_.Silent(Now()).empty())
    OnLost(Error{fmt::format("the master has been silent for {:.0f} s", kSilenceS)});
  heartbeat_.Set(kHeartbeatS, [this] { Heartbeat(); });
}

void Session::GiveUp(const Error& error) {
  if (!connection_) return End(tl::unexpected<Error>(error));
  connection_->Send(MakeMessage(MessageType::kFailure, Failure{error.message}));
  gives_up_ = error;
  retry_.Set(kLastWordsS, [this] { End(tl::unexpected<Error>(*gives_up_)); });
}

void Session::OnMessage(Message m) {
  if (gives_up_) return;
  if (m.type == MessageType::kFarewell) {
    const auto farewell = DecodeFailure(m.table);
    return OnLost(farewell ? Error{farewell->message} : farewell.error());
  }
  if (m.type == MessageType::kFailure) {
    const auto failure = DecodeFailure(m.table);
    return End(failure ? Status(Fail(failure->message)) : Status(tl::unexpected<Error>(failure.error())));
  }
  if (const Status status = Dispatch(m); !status) GiveUp(status.error());
}

Status Session::Dispatch(const Message& m) {
  if (m.type == MessageType::kPing) return {};
  if (m.type == MessageType::kWelcome) return OnWelcome(m);
  if (m.type == MessageType::kCatalog) return OnCatalog(m);
  if (!scene_) return Fail("the master sent other messages before the scene");
  switch (m.type) {
    case MessageType::kSelection:
      return scene_->selections.Take(m.table, scene_->catalog);
    case MessageType::kEnvironment:
      return scene_->environments.Take(m, *io_, OptionsOf(*scene_), *scene_->renderer);
    case MessageType::kFrameSetup:
      return OnFrameSetup(m);
    case MessageType::kTile:
      return OnTile(m);
    case MessageType::kRay:
      return OnRay(m);
    case MessageType::kFramesEnd:
      return OnFramesEnd(m);
    case MessageType::kPeers:
      return OnPeers(m);
    default:
      return Fail(fmt::format("the master sent a message of type {}, which is not for workers",
                              static_cast<int>(m.type)));
  }
}

Status Session::OnWelcome(const Message& m) {
  QUARRY_ASSIGN(const Welcome welcome, DecodeWelcome(m.table));
  if (scene_ && scene_->catalog.id != welcome.scene_id)
    return Fail("the master serves another scene now; start the worker again");
  scene_id_ = welcome.scene_id;
  worker_ = welcome.worker;
  environment_bytes_ = welcome.environment_bytes;
  if (sources_.empty()) sources_ = options_.sources.empty() ? welcome.sources : options_.sources;
  welcomed_ = was_welcomed_ = true;
  const std::string joined =
      fmt::format("has joined the master at {}:{}", options_.master.host, options_.master.port);
  Log(joined);
  NotifyReady(joined);
  return {};
}

Status Session::OnCatalog(const Message& m) {
  if (scene_) return SendStatus(true), Status{};  // a reconnection: the cache is kept
  QUARRY_ASSIGN(const auto sections, UnpackSections(m.raw));
  QUARRY_ASSIGN(Catalog catalog, DecodeCatalog(scene_id_, sections));
  QUARRY_TRY(Renderer::Check(catalog, {options_.cache_bytes}));
  auto scene = std::make_unique<LoadedScene>(std::move(catalog), options_.cache_bytes, environment_bytes_);
  QUARRY_TRY(OpenSupply(*scene));
  QUARRY_TRY(MakeRenderer(*scene));
  scene_ = std::move(scene);
  // The second Hello has the port at which other workers are served.
  SendHello();
  SendStatus(true);
  return {};
}

SupplyOptions Session::OptionsOf(const LoadedScene& scene) {
  return {options_.master,
          options_.security,
          options_.serving,
          sources_,
          !options_.sources.empty(),
          scene.stored_bytes,
          options_.disk_cache,
          options_.http,
          options_.header_servers,
          options_.retry_s,
          [this](const std::string& line) { Log(line); },
          [&scene] { return scene.renderer->loader().idle(); }};
}

Status Session::OpenSupply(LoadedScene& scene) {
  QUARRY_ASSIGN(scene.supply, BlockSupply::Open(*io_, scene.catalog, OptionsOf(scene), scene.inventory));
  if (options_.peers == "off" || scene.stored_bytes == 0) return {};
  if (options_.peers != "auto") {
    QUARRY_ASSIGN(const Endpoint endpoint, ParseEndpoint(options_.peers, "--peers"));
    return scene.supply->Serve(endpoint);
  }
  if (const Status status = scene.supply->Serve({connection_->local_host(), 0}); !status)
    Log(fmt::format("does not serve other workers: {}", status.error().message));
  return {};
}

Status Session::MakeRenderer(LoadedScene& scene) {
  Renderer::Hooks hooks;
  hooks.on_error = [this](const Error& e) { GiveUp(e); };
  hooks.on_block = [&scene](BlockKey block, bool here) {
    if (block.kind() != BlockKind::kSky) scene.inventory.Set(block, CacheInventory::kDecoded, here);
  };
  hooks.on_idle = [&scene] { scene.supply->Prefetch(); };
  QUARRY_ASSIGN(scene.renderer,
                Renderer::Create(
                    scene.catalog, scene.supply->source(),
                    [this](std::function<void()> task) { asio::post(*io_, std::move(task)); },
                    {options_.cache_bytes - scene.stored_bytes, options_.threads}, std::move(hooks)));
  scene.renderer->UseFirst(std::move(memory_));
  return {};
}

Status Session::OnPeers(const Message& m) {
  QUARRY_ASSIGN(Peers peers, DecodePeers(m.table));
  if (const auto own = std::ranges::find(peers.workers, worker_); own != peers.workers.end()) {
    peers.endpoints.erase(peers.endpoints.begin() + (own - peers.workers.begin()));
    peers.workers.erase(own);
  }
  scene_->supply->SetPeers(peers);
  return {};
}

Status Session::OnFrameSetup(const Message& m) {
  QUARRY_ASSIGN(FrameSetup setup, DecodeFrameSetup(m.table));
  if (setup.view.environment.shines() && !scene_->environments.Has(setup.view.environment.id))
    return Fail("the master named an environment that it has not sent");
  QUARRY_ASSIGN(setup.view.parts.selection, scene_->selections.Find(setup.selection));
  if (setup.frame >= Renderer::kFirstOwnView) return Fail("received a frame whose number is too large");
  scene_->renderer->DropViews(0, setup.oldest);
  scene_->renderer->SetView(setup.frame, setup.view);
  return {};
}

Status Session::OnFramesEnd(const Message& m) {
  QUARRY_ASSIGN(const FramesEnd end, DecodeFramesEnd(m.table));
  for (const uint64_t frame : end.frames)
    if (frame < Renderer::kFirstOwnView) scene_->renderer->DropViews(frame, frame + 1);
  return {};
}

Status Session::OnTile(const Message& m) {
  QUARRY_ASSIGN(const TileOrder order, DecodeTileOrder(m.table));
  if (leaves_) {
    GiveBack(order);
    SendLeave(false);
    return {};
  }
  ++tiles_;
  last_tile_ = Clock::now();
  if (!std::exchange(at_work_, true)) Log("is given work");
  scene_->supply->Expect(order);
  QUARRY_TRY(scene_->renderer->Order(
      order.frame, order.area,
      [this, order](RenderedTile result) {
        asio::post(*io_, [this, order, result = std::move(result)]() mutable {
          SendTile(order, std::move(result));
        });
      },
      order.urgency));
  scene_->renderer->Wake();
  return {};
}

Status Session::OnRay(const Message& m) {
  QUARRY_ASSIGN(const RayOrder order, DecodeRayOrder(m.table));
  if (leaves_) return {};  // the master gives it to another worker
  View view;
  view.section = order.section;
  QUARRY_ASSIGN(view.parts.selection, scene_->selections.Find(order.selection));
  QUARRY_TRY(scene_->renderer->Order(
      order.query, view,
      [this, order, to = std::weak_ptr(connection_)](RenderedTile result) {
        asio::post(*io_, [this, order, to, result = std::move(result)] { SendHit(order, to, result); });
      },
      Urgency::kMotion));
  scene_->renderer->Wake();
  return {};
}

/// A master numbers rays anew after a reconnection, so it gets no hits of rays that it gave before.
void Session::SendHit(const RayOrder& order, const std::weak_ptr<Connection>& to,
                      const RenderedTile& result) {
  const auto connection = to.lock();
  if (!connection || connection != connection_ || !result.begun) return;
  const Hit& hit = result.hits.front();
  static_assert(kNoTriangle == kNoIndex);
  connection->Send(MakeMessage(MessageType::kRayDone,
                               RayDone{order.ray, order.lease, hit.t, hit.triangle, hit.voxel, hit.local}));
}

void Session::SendTile(const TileOrder& order, RenderedTile result) {
  if (!connection_) return;  // the lease ends and another worker gets the tile
  if (!result.begun) return GiveBack(order);
  TileDone done{order.frame, order.tile, order.lease, result.rays, result.rays_suspended, result.compute_us};
  if (order.urgency == Urgency::kJob) {
    SendStatus(false);  // first, so that a frame's statistics are complete with its last tile
    done.saturated = result.faults.saturated;
    done.not_numbers = result.faults.not_numbers;
    done.long_light_rays = result.faults.long_light_rays;
    done.depths = std::move(result.depths);
    done.blocks = scene_->catalog.NumbersOf(result.blocks);
  }
  Message m = MakeMessage(MessageType::kTileDone, done);
  m.raw = std::move(result.pixels);
  connection_->Send(std::move(m));
}

Status RunWorker(const WorkerOptions& options) {
  Session session(options);
  return session.Run();
}

}  // namespace quarry

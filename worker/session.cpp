#include "worker/session.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <optional>
#include <random>
#include <utility>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/engine/engine.h"
#include "common/engine/loader.h"
#include "common/engine/page_buffer.h"
#include "common/protocol/messages.h"
#include "worker/block_supply.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;

/// Without a new tile for so long, the log says that the worker waits.
constexpr double kIdleS = 10;

/// What exists once the scene is known, in the order it must be built; taken down in reverse.
struct SceneState {
  SceneState(Catalog scene, const WorkerOptions& options, asio::io_context& io, Engine::OnTile on_tile)
      : catalog(std::move(scene)),
        stored_bytes(
            StoredCache::ShareOf(options.cache_bytes, DecodedBytes(catalog), catalog.meta.largest_decoded)),
        cache(
            catalog, options.cache_bytes - stored_bytes, [this, &io] { ScheduleLoader(io); },
            [this, &io] { ScheduleLoader(io); },
            [this](uint32_t block, bool here) { inventory.Set(block, CacheInventory::kDecoded, here); }),
        make_engine([this, &options, on_tile = std::move(on_tile)] {
          return std::make_unique<Engine>(catalog, cache, options.threads, on_tile);
        }) {}

  /// Once it is known where blocks come from.
  void Begin(std::unique_ptr<BlockSupply> blocks, std::function<void(const Error&)> on_error) {
    supply = std::move(blocks);
    loader = std::make_unique<Loader>(catalog, cache, supply->source(), std::move(on_error));
    engine = make_engine();
  }

  /// Any number of calls before the loader runs make it run once.
  void ScheduleLoader(asio::io_context& io) {
    if (scheduled.exchange(true)) return;
    asio::post(io, [this] {
      scheduled = false;
      loader->Run();
      supply->Prefetch();
    });
  }

  static uint64_t DecodedBytes(const Catalog& catalog) {
    uint64_t bytes = 0;
    for (const VoxelEntry& voxel : catalog.voxels) bytes += voxel.blocks[0].decoded + voxel.blocks[1].decoded;
    return bytes;
  }

  Catalog catalog;
  CacheInventory inventory;
  std::atomic<bool> scheduled{false};
  const uint64_t stored_bytes;
  VoxelCache cache;
  std::function<std::unique_ptr<Engine>()> make_engine;
  std::unique_ptr<BlockSupply> supply;
  std::unique_ptr<Loader> loader;
  std::unique_ptr<Engine> engine;
};

class Session {
 public:
  explicit Session(const WorkerOptions& options)
      : options_(options), retry_(io_), alive_(io_), instance_(NewInstance()) {}

  Status Run() {
    if (options_.pretouch) {
      auto memory = PageBuffer::TryGet(options_.cache_bytes);
      if (!memory)
        return BadUsage(fmt::format("--pretouch: the system has no {} of memory for --cache",
                                    FormatSize(options_.cache_bytes)));
      memory_ = std::move(*memory);
      Log(fmt::format("has {} of memory", FormatSize(options_.cache_bytes)));
    }
    lost_since_ = Clock::now();
    TryConnect();
    Heartbeat();
    io_.run();
    return outcome_;
  }

 private:
  /// What tells this run of this worker from every other; never 0, which stands for none.
  static uint64_t NewInstance() {
    std::random_device random;
    return uint64_t{random()} << 32 | random() | 1;
  }

  void End(Status outcome) {
    outcome_ = std::move(outcome);
    io_.stop();
  }

  void TryConnect() {
    Connect(io_, options_.master, options_.security, [this](Result<std::shared_ptr<Connection>> result) {
      if (!result) return OnLost(result.error());
      connection_ = std::move(*result);
      // What is still on its way from a connection given up is no concern of the next one.
      const Connection* const mine = connection_.get();
      connection_->Expect(Speaker::kMasterOfWorkers);
      connection_->Start(
          [this, mine](Message m) {
            if (mine == connection_.get()) OnMessage(std::move(m));
          },
          [this, mine](const Error& e) {
            if (mine == connection_.get()) OnLost(e);
          });
      received_ = 0;
      heard_ = Clock::now();
      connection_->Send(MakeMessage(MessageType::kHello, Hello{Role::kWorker, options_.name, options_.threads,
                                                               instance_, serves_at()}));
    });
  }

  uint16_t serves_at() const { return scene_ ? scene_->supply->serves_at() : uint16_t{0}; }
  void Log(const std::string& text) const {
    if (!options_.quiet) fmt::print(stderr, "quarry-worker: {}: {}\n", options_.name, text);
  }

  void OnLost(const Error& error) {
    if (gives_up_) return End(tl::unexpected<Error>(*gives_up_));
    if (connection_) connection_->Close();
    connection_.reset();
    if (std::exchange(welcomed_, false)) {
      lost_since_ = Clock::now();
      Log(fmt::format("lost the master, trying for {:.0f} s: {}", options_.retry_s, error.message));
    }
    if (scene_) {
      scene_->engine->DropFrames();
      scene_->supply->ClearExpected();
    }
    // Who has been welcomed once fits the master: what looks like a misfit later is damage on the way, or
    // passes.
    if (error.permanent && !was_welcomed_) return End(tl::unexpected<Error>(error));
    if (SecondsSince(lost_since_) > options_.retry_s) return End(tl::unexpected<Error>(error));
    retry_.expires_after(std::chrono::milliseconds(300));
    retry_.async_wait([this](const boost::system::error_code& e) {
      if (!e) TryConnect();
    });
  }

  void OnMessage(Message m) {
    if (gives_up_) return;
    Status status;
    switch (m.type) {
      case MessageType::kWelcome:
        status = OnWelcome(m);
        break;
      case MessageType::kCatalog:
        status = OnCatalog(m);
        break;
      case MessageType::kFrameSetup:
        status = OnFrameSetup(m);
        break;
      case MessageType::kTile:
        status = OnTile(m);
        break;
      case MessageType::kPeers:
        status = OnPeers(m);
        break;
      case MessageType::kPing:
        break;
      case MessageType::kShutDown:
        return End({});
      case MessageType::kFailure: {
        const auto failure = DecodeFailure(m.table);
        return End(failure ? Status(Fail(failure->message)) : Status(tl::unexpected<Error>(failure.error())));
      }
      default:
        status = Fail(fmt::format("the master sent a message of type {}, which is not for workers",
                                  static_cast<int>(m.type)));
    }
    if (!status) GiveUp(status.error());
  }

  Status OnWelcome(const Message& m) {
    QUARRY_ASSIGN(const Welcome welcome, DecodeWelcome(m.table));
    if (scene_ && scene_->catalog.id != welcome.scene_id)
      return Fail("the master serves another scene now; start the worker again");
    scene_id_ = welcome.scene_id;
    worker_ = welcome.worker;
    if (sources_.empty()) sources_ = options_.sources.empty() ? welcome.sources : options_.sources;
    welcomed_ = was_welcomed_ = true;
    Log(fmt::format("has joined the master at {}:{}", options_.master.host, options_.master.port));
    return {};
  }

  Status OnCatalog(const Message& m) {
    if (scene_) return SendCounters(true), Status{};  // a reconnection: the cache stays warm
    QUARRY_ASSIGN(const auto sections, UnpackSections(m.raw));
    QUARRY_ASSIGN(Catalog catalog, DecodeCatalog(scene_id_, sections));
    if (options_.cache_bytes < catalog.meta.largest_decoded)
      return BadUsage(
          fmt::format("--cache of {} is less than the scene's largest block, {} bytes; give at least that",
                      FormatSize(options_.cache_bytes), catalog.meta.largest_decoded));
    auto scene = std::make_unique<SceneState>(
        std::move(catalog), options_, io_, [this](const TileDone& done, Bytes pixels) {
          asio::post(
              io_, [this, done, pixels = std::move(pixels)]() mutable { SendTile(done, std::move(pixels)); });
        });
    SupplyOptions supply_options{options_.master,
                                 options_.security,
                                 options_.serving,
                                 sources_,
                                 !options_.sources.empty(),
                                 scene->stored_bytes,
                                 options_.disk_cache,
                                 options_.http,
                                 options_.header_servers,
                                 options_.retry_s,
                                 [this](const std::string& line) { Log(line); },
                                 [state = scene.get()] { return state->loader->idle(); }};
    QUARRY_ASSIGN(auto supply, BlockSupply::Open(io_, scene->catalog, supply_options, scene->inventory));
    if (options_.peers != "off" && scene->stored_bytes > 0) {
      if (options_.peers != "auto") {
        QUARRY_ASSIGN(const Endpoint endpoint, ParseEndpoint(options_.peers, "--peers"));
        QUARRY_TRY(supply->Serve(endpoint));
      } else if (const Status status = supply->Serve({connection_->local_host(), 0}); !status) {
        Log(fmt::format("does not serve other workers: {}", status.error().message));
      }
    }
    scene->cache.UseFirst(std::move(memory_));
    scene->Begin(std::move(supply), [this](const Error& e) { GiveUp(e); });
    scene_ = std::move(scene);
    // Known only now: the port at which others are served.
    connection_->Send(MakeMessage(
        MessageType::kHello, Hello{Role::kWorker, options_.name, options_.threads, instance_, serves_at()}));
    SendCounters(true);
    return {};
  }

  Status OnPeers(const Message& m) {
    if (!scene_) return Fail("the master named other workers before it gave the scene");
    QUARRY_ASSIGN(Peers peers, DecodePeers(m.table));
    for (size_t i = 0; i < peers.workers.size(); ++i)
      if (peers.workers[i] == worker_) {
        peers.workers.erase(peers.workers.begin() + static_cast<std::ptrdiff_t>(i));
        peers.endpoints.erase(peers.endpoints.begin() + static_cast<std::ptrdiff_t>(i));
        break;
      }
    scene_->supply->SetPeers(peers);
    return {};
  }

  Status OnFrameSetup(const Message& m) {
    if (!scene_) return Fail("the master set up a frame before it gave the scene");
    QUARRY_ASSIGN(const FrameSetup setup, DecodeFrameSetup(m.table));
    scene_->engine->SetFrame(setup);
    return {};
  }

  Status OnTile(const Message& m) {
    if (!scene_) return Fail("the master gave a tile before it gave the scene");
    QUARRY_ASSIGN(const TileOrder order, DecodeTileOrder(m.table));
    ++tiles_;
    given_ = Clock::now();
    if (!std::exchange(at_work_, true)) Log("is given work");
    scene_->supply->Expect(order);
    scene_->engine->AddTile(order);
    scene_->ScheduleLoader(io_);
    return {};
  }

  void SendTile(const TileDone& done, Bytes pixels) {
    if (!connection_) return;  // the lease runs out, another gets the tile
    SendCounters(false);       // so that a frame's statistics are complete with its last tile
    Message m = MakeMessage(MessageType::kTileDone, done);
    m.raw = std::move(pixels);
    connection_->Send(std::move(m));
  }

  /// `whole`: all blocks held are named, not only the changes.
  void SendCounters(bool whole) {
    if (!connection_ || !welcomed_ || !scene_) return;
    // Asking the system takes longer than all else here.
    constexpr auto kOften = std::chrono::milliseconds(50);
    if (whole || Clock::now() - peak_asked_ > kOften) {
      peak_asked_ = Clock::now();
      peak_rss_ = PeakResidentBytes();
    }
    const VoxelCache::Counters c = scene_->cache.counters();
    WorkerStatus alive{c.bytes,
                       c.loaded,
                       c.bytes_loaded,
                       0,
                       c.evictions,
                       scene_->engine->rays(),
                       scene_->engine->rays_suspended(),
                       peak_rss_};
    alive.whole = whole;
    if (whole) {
      alive.cached = scene_->inventory.TakeAll();
    } else {
      auto changes = scene_->inventory.TakeChanges();
      alive.cached = std::move(changes.come);
      alive.dropped = std::move(changes.gone);
    }
    const SourceSet::Counters& from = scene_->supply->counters();
    const StoredCache::Counters stored = scene_->supply->stored();
    alive.bytes_from = from.bytes_from;
    for (const uint64_t bytes : alive.bytes_from) alive.voxel_bytes_received += bytes;
    alive.bytes_from[static_cast<size_t>(SourceKind::kMemory)] = stored.hit_bytes;
    alive.bytes_from[static_cast<size_t>(SourceKind::kDisk)] = scene_->supply->bytes_from_disk();
    alive.fetch_us = from.busy_us;
    alive.decode_us = scene_->loader->decode_us();
    alive.tiles_wanted = scene_->engine->tiles_wanted();
    alive.retries = from.retries;
    alive.hedges = from.hedges;
    alive.damaged = from.damaged;
    alive.stall_us = scene_->engine->stall_us();
    alive.compute_us = scene_->engine->compute_us();
    alive.prefetched_bytes = stored.prefetched_bytes;
    alive.prefetch_wasted_bytes = stored.prefetch_wasted_bytes;
    connection_->Send(MakeMessage(MessageType::kWorkerStatus, alive));
  }

  /// Says that this worker lives, and looks whether the master does.
  void Heartbeat() {
    // A worker that was itself stopped has not listened meanwhile.
    const Clock::time_point now = Clock::now();
    if (std::chrono::duration<double>(now - std::exchange(looked_, now)).count() > kSilenceS / 2)
      heard_ = now;
    SendCounters(false);
    if (at_work_ && SecondsSince(given_) > kIdleS) {
      at_work_ = false;
      Log(fmt::format("waits for work; {} tiles so far", tiles_));
    }
    if (connection_ && !scene_) connection_->Send({MessageType::kPing, 0, {}, {}});
    if (connection_) {
      if (const uint64_t received = connection_->received_bytes(); received != received_) {
        received_ = received;
        heard_ = Clock::now();
      }
      const double silent_s = SecondsSince(heard_);
      if (silent_s > kSilenceS)
        OnLost(Error{fmt::format("the master has been silent for {:.0f} s", silent_s)});
    }
    alive_.expires_after(std::chrono::milliseconds(static_cast<int>(kHeartbeatS * 1000)));
    alive_.async_wait([this](const boost::system::error_code& e) {
      if (!e) Heartbeat();
    });
  }

  /// Ends, once the master has heard why.
  void GiveUp(const Error& error) {
    if (!connection_) return End(tl::unexpected<Error>(error));
    connection_->Send(MakeMessage(MessageType::kFailure, Failure{error.message}));
    // The master answers by closing the connection, when it has read that.
    gives_up_ = error;
    retry_.expires_after(std::chrono::seconds(10));
    retry_.async_wait([this](const boost::system::error_code& e) {
      if (!e) End(tl::unexpected<Error>(*gives_up_));
    });
  }

  const WorkerOptions& options_;
  asio::io_context io_;
  asio::steady_timer retry_, alive_;
  std::shared_ptr<Connection> connection_;
  bool welcomed_ = false, was_welcomed_ = false;
  std::optional<Error> gives_up_;  ///< why work cannot go on
  Clock::time_point lost_since_, heard_, looked_;
  Clock::time_point given_;  ///< a tile, last
  uint64_t tiles_ = 0;
  bool at_work_ = false;   ///< as the log says
  uint64_t received_ = 0;  ///< bytes, when it last changed
  const uint64_t instance_;
  uint32_t worker_ = 0;  ///< the master's number for this one
  uint64_t peak_rss_ = 0;
  Clock::time_point peak_asked_;
  SceneId scene_id_{};
  std::vector<std::string> sources_;
  PageBuffer memory_;  ///< got beforehand, until the scene is known
  std::unique_ptr<SceneState> scene_;
  Status outcome_;
};

}  // namespace

Status RunWorker(const WorkerOptions& options) {
  Session session(options);
  return session.Run();
}

}  // namespace quarry

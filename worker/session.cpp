#include "worker/session.h"

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <optional>
#include <utility>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/net/tcp_source.h"
#include "common/protocol/messages.h"
#include "worker/engine.h"
#include "worker/loader.h"

namespace quarry {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;

/// What exists once the scene is known, in the order it must be built; taken down in reverse.
struct SceneState {
  SceneState(Catalog scene, const WorkerOptions& options, asio::io_context& io,
             std::function<void(const Error&)> on_error, Engine::OnTile on_tile)
      : catalog(std::move(scene)),
        cache(
            catalog, options.cache_bytes, [this, &io] { ScheduleLoader(io); },
            [this, &io] { ScheduleLoader(io); }),
        source(io, options.master, options.security, catalog.id, options.retry_s),
        loader(catalog, cache, source, std::move(on_error)),
        engine(catalog, cache, options.threads, std::move(on_tile)) {}

  /// Any number of calls before the loader runs make it run once.
  void ScheduleLoader(asio::io_context& io) {
    if (scheduled.exchange(true)) return;
    asio::post(io, [this] {
      scheduled = false;
      loader.Run();
    });
  }

  Catalog catalog;
  std::atomic<bool> scheduled{false};
  VoxelCache cache;
  TcpVoxelSource source;
  Loader loader;
  Engine engine;
};

class Session {
 public:
  explicit Session(const WorkerOptions& options) : options_(options), retry_(io_), alive_(io_) {}

  Status Run() {
    lost_since_ = Clock::now();
    TryConnect();
    io_.run();
    return outcome_;
  }

 private:
  void End(Status outcome) {
    outcome_ = std::move(outcome);
    io_.stop();
  }

  void TryConnect() {
    Connect(io_, options_.master, options_.security, [this](Result<std::shared_ptr<Connection>> result) {
      if (!result) return OnLost(result.error());
      connection_ = std::move(*result);
      connection_->Start([this](Message m) { OnMessage(std::move(m)); },
                         [this](const Error& e) { OnLost(e); });
      connection_->Send(
          MakeMessage(MessageType::kHello, Hello{Role::kWorker, options_.name, options_.threads}));
    });
  }

  void OnLost(const Error& error) {
    connection_.reset();
    if (std::exchange(welcomed_, false)) lost_since_ = Clock::now();
    if (scene_) scene_->engine.DropTiles();
    if (error.permanent) return End(tl::unexpected<Error>(error));
    if (std::chrono::duration<double>(Clock::now() - lost_since_).count() > options_.retry_s)
      return End(tl::unexpected<Error>(error));
    retry_.expires_after(std::chrono::milliseconds(300));
    retry_.async_wait([this](const boost::system::error_code& e) {
      if (!e) TryConnect();
    });
  }

  void OnMessage(Message m) {
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
    if (!status) End(std::move(status));
  }

  Status OnWelcome(const Message& m) {
    QUARRY_ASSIGN(const Welcome welcome, DecodeWelcome(m.table));
    if (scene_ && scene_->catalog.id != welcome.scene_id)
      return Fail("the master serves another scene now; start the worker again");
    scene_id_ = welcome.scene_id;
    welcomed_ = true;
    return {};
  }

  Status OnCatalog(const Message& m) {
    if (scene_) return {};  // a reconnection: the cache stays warm
    QUARRY_ASSIGN(const auto sections, UnpackSections(m.raw));
    QUARRY_ASSIGN(Catalog catalog, DecodeCatalog(scene_id_, sections));
    if (options_.cache_bytes < catalog.meta.largest_decoded)
      return BadUsage(
          fmt::format("--cache of {} is less than the scene's largest block, {} bytes; give at least that",
                      FormatSize(options_.cache_bytes), catalog.meta.largest_decoded));
    scene_ = std::make_unique<SceneState>(
        std::move(catalog), options_, io_, [this](const Error& e) { OnBlockError(e); },
        [this](const TileDone& done, Bytes pixels) {
          asio::post(
              io_, [this, done, pixels = std::move(pixels)]() mutable { SendTile(done, std::move(pixels)); });
        });
    SendAlive();
    return {};
  }

  Status OnFrameSetup(const Message& m) {
    if (!scene_) return Fail("the master set up a frame before it gave the scene");
    QUARRY_ASSIGN(const FrameSetup setup, DecodeFrameSetup(m.table));
    scene_->engine.SetFrame(setup);
    return {};
  }

  Status OnTile(const Message& m) {
    if (!scene_) return Fail("the master gave a tile before it gave the scene");
    QUARRY_ASSIGN(const TileOrder order, DecodeTileOrder(m.table));
    scene_->engine.AddTile(order);
    return {};
  }

  void SendTile(const TileDone& done, Bytes pixels) {
    if (!connection_) return;  // the lease runs out, another gets the tile
    SendCounters();            // so that a frame's statistics are complete with its last tile
    Message m = MakeMessage(MessageType::kTileDone, done);
    m.raw = std::move(pixels);
    connection_->Send(std::move(m));
  }

  void SendCounters() {
    if (!connection_ || !scene_) return;
    const VoxelCache::Counters c = scene_->cache.counters();
    connection_->Send(
        MakeMessage(MessageType::kAlive,
                    Alive{c.bytes, c.loaded, c.bytes_loaded, scene_->loader.bytes_received(), c.evictions,
                          scene_->engine.rays(), scene_->engine.rays_suspended(), PeakResidentBytes()}));
  }

  /// Once a second: the master takes silence for death.
  void SendAlive() {
    SendCounters();
    alive_.expires_after(std::chrono::seconds(1));
    alive_.async_wait([this](const boost::system::error_code& e) {
      if (!e) SendAlive();
    });
  }

  void OnBlockError(const Error& error) {
    if (!connection_) return End(tl::unexpected<Error>(error));
    connection_->Send(MakeMessage(MessageType::kFailure, Failure{error.message}));
    connection_->Close();
    // Leave the message time to go out; then end.
    retry_.expires_after(std::chrono::milliseconds(200));
    retry_.async_wait([this, error](const boost::system::error_code&) { End(tl::unexpected<Error>(error)); });
  }

  const WorkerOptions& options_;
  asio::io_context io_;
  asio::steady_timer retry_, alive_;
  std::shared_ptr<Connection> connection_;
  bool welcomed_ = false;
  Clock::time_point lost_since_;
  SceneId scene_id_{};
  std::unique_ptr<SceneState> scene_;
  Status outcome_;
};

}  // namespace

Status RunWorker(const WorkerOptions& options) {
  Session session(options);
  return session.Run();
}

}  // namespace quarry

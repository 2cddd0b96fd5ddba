// A worker whose master, voxel servers and fellow workers follow the bytes, in any order and at any time. At
// the end all of them behave: the worker must render a tile to its usual pixels, or have ended with a
// sentence.
#include <chrono>
#include <cstdlib>
#include <deque>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "tests/fuzz/memory_net.h"
#include "tests/fuzz/session_script.h"
#include "worker/session.h"

namespace quarry::fuzz {
namespace {

/// Actions that an input's bytes choose; the seeds are written in them.
enum Action : uint8_t {
  kWelcome,
  kCatalog,
  kSetup,
  kTile,
  kPeers,
  kAny,
  kBreak,
  kTime,
  kServe,
  kServeHeld,
  kAsk,
  kMeet,
  kPause,
  kRay,
  kActions
};
/// How voxels are served.
enum class Serving : uint8_t { kRight, kDamaged, kRefused, kHeld, kOdd, kMany };

constexpr uint16_t kMasterPort = 1;
constexpr uint64_t kLastFrame = uint64_t{1} << 40;

View LastView() {
  View view;
  view.width = view.height = 32;
  view.crop = {0, 0, 32, 32};
  view.mode = RenderMode::kWhitted;
  const SceneMeta& scene = Store().catalog().meta;
  const glm::dvec3 lower(scene.bounds_lower), upper(scene.bounds_upper), middle = (lower + upper) * 0.5;
  view.camera = {middle + (upper - lower) * glm::dvec3(0.9, 0.8, 0.7), middle, {0, 0, 1}};
  return view;
}

/// The pixels of LastView, once they have been rendered.
std::optional<Bytes>& Reference() {
  static std::optional<Bytes> pixels;
  return pixels;
}

class Cast {
 public:
  explicit Cast(Script& script) : script_(script) {}

  bool Reachable(const Endpoint& to) const {
    return last_ || to.port == kMasterPort || script_hides_ % 3 != 0;
  }

  void OnConnected(const MemoryConnectionPtr& c) {
    c->on_sent = [this, &c = *c](const Message& m) { OnSent(c, m); };
    if (std::exchange(io_, &c->io()) == nullptr) Repeat(*io_, [this] { return Step(); });
  }
  void OnListen(std::function<MemoryConnectionPtr()> accept) { accept_ = std::move(accept); }

 private:
  bool Step() {
    if (!script_.over()) return Act(), true;
    Finish();
    return true;  // the worker's end is the end
  }

  void OnSent(MemoryConnection& c, const Message& m) {
    if (m.type == MessageType::kHello && DecodeHello(m.table)->role == Role::kWorker) {
      master_ = std::static_pointer_cast<MemoryConnection>(c.shared_from_this());
      greeted_ = false;
    }
    if (m.type == MessageType::kHello && DecodeHello(m.table)->role == Role::kVoxels)
      c.Come(MakeMessage(MessageType::kWelcome, Welcome{Store().catalog().id, 0, {}}));
    if (m.type == MessageType::kBlockRequest)
      Serve({std::static_pointer_cast<MemoryConnection>(c.shared_from_this()),
             DecodeBlockRequest(m.table)->block, m.request},
            serving_);
    if (m.type == MessageType::kTileDone && DecodeTileDone(m.table)->frame == kLastFrame) {
      if (!Reference()) Reference() = m.raw;
      if (*Reference() != m.raw) {
        std::fprintf(stderr, "the tile has other pixels than before\n");
        std::abort();
      }
      c.Come(MakeMessage(MessageType::kFailure, Failure{"the play is over"}));
    }
  }

  struct Request {
    MemoryConnectionPtr from;
    uint32_t block;
    uint64_t request;
  };
  void Serve(const Request& r, Serving how) {
    const std::optional<BlockKey> key = Store().catalog().BlockOf(r.block);
    if (!key) {
      std::fprintf(stderr, "the worker asks for block %u\n", r.block);
      std::abort();
    }
    Bytes block = *Store().ReadBlock(*key);
    const Message right{MessageType::kBlock, r.request, {}, block};
    switch (how) {
      case Serving::kRight:
        return r.from->Come(right);
      case Serving::kDamaged:
        if (!block.empty()) block[block.size() / 2] ^= std::byte{1};
        return r.from->Come({MessageType::kBlock, r.request, {}, std::move(block)});
      case Serving::kRefused:
        return r.from->Come(MakeMessage(MessageType::kFailure, Failure{"no such block"}, r.request));
      case Serving::kHeld:
        return held_.push_back(r);
      case Serving::kOdd:
        held_.push_back(r);
        return r.from->Come({MessageType::kBlock, r.request + 1, {}, std::move(block)});
      case Serving::kMany:
        for (int i = 0; i < 3; ++i) r.from->Come(right);
        return;
    }
  }

  void ServeHeld(Serving how) {
    for (const Request& r : std::exchange(held_, {})) Serve(r, how);
  }

  void Act() {
    const uint32_t action = script_.Below(kActions);
    ++script_hides_;
    switch (action) {
      case kTime:
        return PassTime(*io_, kTimes[script_.Below(std::size(kTimes))]);
      case kServe:
        serving_ = static_cast<Serving>(script_.Below(6));
        return;
      case kServeHeld:
        return ServeHeld(static_cast<Serving>(script_.Below(6)));
      case kPause:  // for the compute threads
        return std::this_thread::sleep_for(std::chrono::microseconds(200));
      case kMeet:
        return Meet();
      default:
        if (master_) Say(action);
    }
  }

  /// Another worker comes, or one that is here asks.
  void Meet() {
    if (!accept_) return;
    if (fellows_.empty() || (script_.Below(3) == 0 && fellows_.size() < 4)) {
      fellows_.push_back(accept_());
      if (script_.Below(8))
        fellows_.back()->Come(MakeMessage(MessageType::kHello, Hello{Role::kVoxels, "fellow", 0}));
    }
    MemoryConnection& fellow = *fellows_[script_.Below(static_cast<uint32_t>(fellows_.size()))];
    switch (script_.Below(4)) {
      case 0:
        return fellow.Come(AnyMessage(script_));
      case 1:
        return fellow.SetReads(script_.Below(2) == 0);
      case 2:
        return fellow.Break(false);
      default:
        return fellow.Come(
            MakeMessage(MessageType::kBlockRequest, BlockRequest{script_.Number()}, script_.Number()));
    }
  }

  void Say(uint32_t action) {
    switch (action) {
      case kWelcome: {
        SceneId scene = Store().catalog().id;
        if (script_.Below(8) == 7) scene = {};
        std::vector<std::string> sources = {"master"};
        if (script_.Below(3) == 1) sources = {"127.0.0.1:7", "127.0.0.1:8"};
        return master_->Come(
            MakeMessage(MessageType::kWelcome, Welcome{scene, script_.Below(4), std::move(sources)}));
      }
      case kCatalog: {
        Bytes sections = PackSections(Store().catalog_sections());
        if (script_.Below(8) == 7) sections[script_.Number() % sections.size()] ^= std::byte{4};
        return master_->Come({MessageType::kCatalog, 0, {}, std::move(sections)});
      }
      case kSetup:
        return master_->Come(
            MakeMessage(MessageType::kFrameSetup,
                        FrameSetup{script_.Below(4), FrameView(AnyJob(script_)), script_.Below(4)}));
      case kTile: {
        TileOrder order{script_.Below(4),      script_.Number(),      script_.Number(),
                        16 * script_.Below(4), 16 * script_.Below(4), 1 + script_.Below(32),
                        1 + script_.Below(32)};
        for (uint32_t hints = script_.Below(8); hints > 0; --hints) {
          order.blocks.push_back(script_.Byte());
          order.holders.push_back(script_.Below(4));
        }
        return master_->Come(MakeMessage(MessageType::kTile, order));
      }
      case kRay: {
        RayOrder order{script_.Below(4), script_.Number(), {LastView().camera.eye}};
        order.query.direction = LastView().camera.at - LastView().camera.eye;
        if (script_.Below(4) == 0) order.query.end = script_.Byte();
        return master_->Come(MakeMessage(MessageType::kRay, order));
      }
      case kPeers: {
        Peers peers;
        for (uint32_t n = script_.Below(4); n > 0; --n) {
          peers.workers.push_back(script_.Below(4));
          peers.endpoints.push_back(script_.Below(8) == 7 ? script_.Text()
                                                          : "127.0.0.1:1" + std::to_string(script_.Below(4)));
        }
        return master_->Come(MakeMessage(MessageType::kPeers, peers));
      }
      case kAny:
        return master_->Come(AnyMessage(script_));
      case kBreak:
        return master_->Break(script_.Below(4) == 3);
      default:
        return;
    }
  }

  /// One step of the end.
  void Finish() {
    if (!std::exchange(last_, true)) {
      serving_ = Serving::kRight;
      ServeHeld(Serving::kRight);
    }
    if (++steps_ > kRounds) NeverEnds("a worker with a tile");
    if (master_ && !master_->closed() && !std::exchange(greeted_, true)) {
      Welcome welcome{Store().catalog().id, 1, {"master"}};
      master_->Come(MakeMessage(MessageType::kWelcome, welcome));
      master_->Come({MessageType::kCatalog, 0, {}, PackSections(Store().catalog_sections())});
      master_->Come(MakeMessage(MessageType::kFrameSetup, FrameSetup{kLastFrame, LastView(), kLastFrame}));
      master_->Come(MakeMessage(MessageType::kTile, TileOrder{kLastFrame, 0, 1, {{0, 0, 32, 32}}}));
    }
    if (master_) master_->Come({MessageType::kPing, 0, {}, {}});
    PassTime(*io_, 0.01);
    std::this_thread::sleep_for(std::chrono::microseconds(20));
  }

  static constexpr double kTimes[] = {0.01, 0.1, 0.4, 1, 3, 7};
  static constexpr int kRounds = 200'000;
  Script& script_;
  boost::asio::io_context* io_ = nullptr;
  std::function<MemoryConnectionPtr()> accept_;
  MemoryConnectionPtr master_;  ///< the newest
  std::vector<MemoryConnectionPtr> fellows_;
  Serving serving_ = Serving::kRight;
  std::deque<Request> held_;
  uint32_t script_hides_ = 1;
  bool greeted_ = false, last_ = false;
  int steps_ = 0;
};

}  // namespace

std::vector<std::vector<uint8_t>> Seeds() {
  std::vector<std::vector<uint8_t>> seeds = {{0, 0}};
  // Cache and threads; a greeting, the scene, a frame of 64x64 (see AnyJob), tiles, and how voxels come
  // meanwhile.
  for (uint8_t cache = 0; cache < 3; ++cache)
    for (uint8_t serving = 0; serving < 6; ++serving)
      seeds.push_back({cache, 1,   kServe, serving,    kWelcome, 0,      0,     1,      kCatalog, 0, kPeers,
                       2,     1,   0,      1,          2,        0,      2,     kSetup, 1,        3, 3,
                       1,     2,   1,      0,          0,        127,    1,     0,      1,        1, 1,
                       0,     200, 90,     1,          kTile,    1,      0,     1,      0,        0, 31,
                       31,    2,   4,      2,          6,        1,      kTile, 1,      1,        2, 2,
                       2,     31,  31,     0,          kPause,   kTime,  1,     kMeet,  0,        1, 0,
                       3,     4,   1,      kServeHeld, 0,        kBreak, 0,     kTime,  2});
  return seeds;
}

}  // namespace quarry::fuzz

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  using namespace quarry;
  fuzz::Script script(data, size);
  const uint64_t largest = fuzz::Store().catalog().meta.largest_decoded;
  const uint64_t caches[] = {16u << 20, largest, 4 * largest, largest - 1};
  WorkerOptions options;
  options.master = {"127.0.0.1", fuzz::kMasterPort};
  options.cache_bytes = caches[script.Below(4)];
  options.threads = 1 + script.Below(2);
  options.name = "fuzzed";
  options.retry_s = 30;
  options.quiet = true;
  fuzz::MemoryNet net;
  fuzz::Cast cast(script);
  net.on_connect = [&](const Endpoint& to) { return cast.Reachable(to); };
  net.on_connected = [&](const auto& connection) { cast.OnConnected(connection); };
  net.on_listen = [&](auto&, auto accept) { cast.OnListen(std::move(accept)); };
  const Status status = RunWorker(options);
  if (!status && status.error().message.empty()) std::abort();
  return 0;
}

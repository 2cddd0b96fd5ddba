// A worker whose master says what the bytes tell, in whatever order. It must end, with a sentence where it
// fails. The scene is the store named by QUARRY_FUZZ_STORE; its blocks are served, some of them damaged.
#include <fuzzer/FuzzedDataProvider.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <set>
#include <thread>
#include <utility>

#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "common/voxel/store_reader.h"
#include "worker/session.h"

namespace {

using namespace quarry;
using ConnectionPtr = std::shared_ptr<Connection>;

StoreReader& Store() {
  static StoreReader store = [] {
    const char* path = std::getenv("QUARRY_FUZZ_STORE");
    auto opened = StoreReader::Open(path ? path : "");
    if (!opened) {
      std::fprintf(stderr, "QUARRY_FUZZ_STORE names no store: %s\n", opened.error().message.c_str());
      std::exit(1);
    }
    return std::move(*opened);
  }();
  return store;
}

RenderJob SmallJob(FuzzedDataProvider& script) {
  RenderJob job;
  job.width = job.height = job.crop_width = job.crop_height = 64;
  job.format = "png";
  job.mode = static_cast<RenderMode>(script.ConsumeIntegralInRange<int>(0, kRenderModes - 1));
  const SceneMeta& scene = Store().catalog().meta;
  job.lights.push_back({LightKind::kSun, {0.3f, 0.4f, 1}, {1, 1, 1}});
  const glm::dvec3 middle = (glm::dvec3(scene.bounds_lower) + glm::dvec3(scene.bounds_upper)) * 0.5;
  const glm::dvec3 size = glm::dvec3(scene.bounds_upper) - glm::dvec3(scene.bounds_lower);
  job.cameras.push_back({middle + size * glm::dvec3(0.9, 0.8, 0.7), middle, {0, 0, 1}});
  return job;
}

class Master {
 public:
  explicit Master(FuzzedDataProvider& script) : script_(script), timer_(io_) {
    auto opened = Listener::Open(io_, {"127.0.0.1", 0}, {}, [this](ConnectionPtr c) { OnConnection(c); });
    if (!opened) std::abort();
    listener_ = std::move(*opened);
    thread_ = std::thread([this] { io_.run(); });
  }
  ~Master() {
    boost::asio::post(io_, [this] { io_.stop(); });
    thread_.join();
  }
  uint16_t port() const { return listener_->port(); }

 private:
  void OnConnection(const ConnectionPtr& c) {
    c->Start([this, c](Message m) { OnMessage(c, m); }, [this, c](const Error&) { voxels_.erase(c); });
  }

  void OnMessage(const ConnectionPtr& c, const Message& m) {
    if (m.type == MessageType::kBlockRequest) return Serve(c, m);
    if (m.type != MessageType::kHello || !DecodeHello(m.table)) return;
    if (DecodeHello(m.table)->role == Role::kVoxels) {
      voxels_.insert(c);
      return c->Send(MakeMessage(MessageType::kWelcome, Welcome{Store().catalog().id, 0, {}}));
    }
    while (script_.remaining_bytes() > 0) Say(c);
    // Some time to render what was asked for; then the end.
    timer_.expires_after(std::chrono::milliseconds(3));
    timer_.async_wait([c](const boost::system::error_code&) {
      c->Send({MessageType::kShutDown, 0, {}, {}});
      c->Close();
    });
  }

  void Serve(const ConnectionPtr& c, const Message& m) {
    const auto request = DecodeBlockRequest(m.table);
    if (!request || request->block / 2 >= Store().catalog().voxels.size()) std::abort();
    auto block = Store().ReadBlock(request->block);
    if (!block) return c->Send(MakeMessage(MessageType::kFailure, Failure{"no such block"}, m.request));
    if (request->block % 11 == 10 && !block->empty()) (*block)[block->size() / 2] ^= std::byte{1};
    c->Send({MessageType::kBlock, m.request, {}, std::move(*block)});
  }

  void Say(const ConnectionPtr& c) {
    const auto small = [this] { return script_.ConsumeIntegralInRange<uint32_t>(0, 3); };
    switch (script_.ConsumeIntegralInRange<int>(0, 7)) {
      case 0: {
        SceneId scene = Store().catalog().id;
        if (small() == 3) scene = SceneId{};
        return c->Send(MakeMessage(MessageType::kWelcome, Welcome{scene, small(), {"master"}}));
      }
      case 1: {
        Bytes sections = PackSections(Store().catalog_sections());
        for (uint32_t flips = small() == 3 ? 1 : 0; flips > 0; --flips)
          sections[script_.ConsumeIntegral<uint32_t>() % sections.size()] ^= std::byte{4};
        return c->Send({MessageType::kCatalog, 0, {}, std::move(sections)});
      }
      case 2:
        return c->Send(
            MakeMessage(MessageType::kFrameSetup, FrameSetup{small(), SmallJob(script_), small()}));
      case 3: {
        TileOrder order{small(),      small(),         small(),        16 * small(),
                        16 * small(), 1 + 8 * small(), 1 + 8 * small()};
        for (uint32_t hints = small(); hints > 0; --hints) {
          order.blocks.push_back(script_.ConsumeIntegral<uint32_t>() >> (8 * small()));
          order.holders.push_back(small());
        }
        return c->Send(MakeMessage(MessageType::kTile, order));
      }
      case 4:
        return c->Send(
            MakeMessage(MessageType::kPeers,
                        Peers{{1, small()}, {"127.0.0.1:1", script_.ConsumeRandomLengthString(20)}}));
      case 5:
        return c->Send({MessageType::kPing, 0, {}, {}});
      case 6: {
        const auto type = static_cast<MessageType>(script_.ConsumeIntegralInRange<int>(1, kMessageTypes - 1));
        const std::string table = script_.ConsumeRandomLengthString(64);
        return c->Send({type, small(), Bytes(AsBytes(table).begin(), AsBytes(table).end()), {}});
      }
      default:
        if (small() == 3) c->Close();
    }
  }

  FuzzedDataProvider& script_;
  boost::asio::io_context io_;
  boost::asio::steady_timer timer_;
  std::unique_ptr<Listener> listener_;
  std::set<ConnectionPtr> voxels_;
  std::thread thread_;
};

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  FuzzedDataProvider script(data, size);
  Master master(script);
  WorkerOptions options;
  options.master = {"127.0.0.1", master.port()};
  options.cache_bytes = 4 << 20;
  options.name = "fuzzed";
  options.retry_s = 0;
  options.quiet = true;
  const Status status = RunWorker(options);
  if (!status && status.error().message.empty()) std::abort();
  return 0;
}

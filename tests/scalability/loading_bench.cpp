// `quarry bench loading` measures the gain of suspending rays. The engine renders a walk on one core, with
// blocks from a line of a given latency and bandwidth, cold and warm: with suspended rays; with a thread that
// waits for each voxel; and with the decoded store mapped into memory as from a file server.
#include <fmt/format.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <condition_variable>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>
#include <utility>

#include "common/base/log.h"
#include "common/engine/renderer.h"
#include "common/program/run_program.h"
#include "common/scene/framing.h"
#include "common/voxel/store_reader.h"
#include "deploy/command/scene_files.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/stopwatch.h"
#include "tests/scalability/line.h"
#include "tests/scalability/mapped_blocks.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

namespace asio = boost::asio;

struct Options {
  std::string store, path, json, mode = "raycast";
  std::vector<double> latencies_ms{0.4, 5}, mbits{25, 100, 400};
  uint32_t width = 320, height = 240;
};

/// Binds the process to one core, as a worker with one thread has.
void PinToOneCore() {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<size_t>(sched_getcpu()), &set);
  sched_setaffinity(0, sizeof set, &set);
}

/// A source of a store's blocks behind a line.
class LineSource : public VoxelSource {
 public:
  /// `io`: runs the callbacks; null: Fetch() waits itself.
  LineSource(const StoreReader& store, Line& line, asio::io_context* io)
      : store_(store), line_(line), io_(io) {}

  void Fetch(BlockKey block, Done done) override {
    const auto here = line_.Ask(store_.catalog().block(block).stored);
    if (!io_) {
      std::this_thread::sleep_until(here);
      return done(store_.ReadBlock(block));
    }
    auto timer = std::make_shared<asio::steady_timer>(*io_, here);
    timer->async_wait([this, block, timer, done = std::move(done)](const boost::system::error_code& e) {
      if (!e) done(store_.ReadBlock(block));
    });
  }

 private:
  const StoreReader& store_;
  Line& line_;
  asio::io_context* io_;
};

/// Figures of a frame of the walk.
struct FrameCost {
  double compute_s = 0;          ///< tracing and shading
  std::vector<BlockKey> blocks;  ///< blocks touched in this frame first
};

/// A renderer with one thread and a cache for the whole scene.
class Walker {
 public:
  enum class Loading { kSuspend, kWait, kMap };

  Walker(const StoreReader& store, Line& line, Loading loading)
      : source_(store, line, loading == Loading::kSuspend ? &io_ : nullptr),
        renderer_(*Renderer::Create(store.catalog(), source_, Runs(loading), {uint64_t{1} << 40, 1},
                                    {[this](const Error& e) { Give(e); }, {}, {}})) {
    if (loading == Loading::kSuspend) loader_thread_ = std::thread([this] { io_.run(); });
  }
  ~Walker() {
    work_.reset();
    io_.stop();
    if (loader_thread_.joinable()) loader_thread_.join();
  }

  /// By block number.
  void Publish(std::vector<std::unique_ptr<ResidentBlock>> blocks) {
    for (uint32_t number = 0; number < blocks.size(); ++number)
      if (blocks[number])
        renderer_->Publish(*renderer_->catalog().BlockOf(number), std::move(blocks[number]));
  }

  /// Renders a frame for each camera, tile after tile; rays of several tiles are under way. Returns: seconds.
  Result<double> Walk(View view, const std::vector<CameraSpec>& cameras, std::vector<FrameCost>& costs) {
    costs.assign(cameras.size(), {});
    seen_.clear();
    const std::vector<Tile> tiles = TilesOf(view.crop);
    left_ = cameras.size() * tiles.size();
    for (size_t f = 0; f < cameras.size(); ++f) {
      view.camera = cameras[f];
      renderer_->SetView(f, view);
    }
    const auto start = Clock::now();
    for (size_t f = 0; f < cameras.size(); ++f)
      for (const Tile& tile : tiles)
        renderer_->Order(f, tile,
                         [this, &cost = costs[f]](const RenderedTile& result) { Put(result, cost); });
    std::unique_lock lock(mutex_);
    done_.wait(lock, [&] { return left_ == 0 || error_; });
    if (error_) return tl::unexpected<Error>(*error_);
    const double seconds = SecondsSince(start);
    renderer_->DropViews(0, cameras.size());
    return seconds;
  }

 private:
  /// The loader's executor: a thread of its own, or the compute thread.
  Executor Runs(Loading loading) {
    if (loading == Loading::kSuspend)
      return [this](std::function<void()> task) { asio::post(io_, std::move(task)); };
    return [](const std::function<void()>& task) { task(); };
  }
  void Give(const Error& error) {
    const std::lock_guard lock(mutex_);
    error_ = error;
    done_.notify_one();
  }
  void Put(const RenderedTile& result, FrameCost& cost) {
    cost.compute_s += static_cast<double>(result.compute_us) * 1e-6;
    for (const BlockKey block : result.blocks)
      if (seen_.insert(block).second) cost.blocks.push_back(block);
    const std::lock_guard lock(mutex_);
    if (--left_ == 0) done_.notify_one();
  }

  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
  LineSource source_;
  std::set<BlockKey> seen_;  ///< used by the compute thread
  std::mutex mutex_;         ///< guards left_, error_
  std::condition_variable done_;
  size_t left_ = 0;
  std::optional<Error> error_;
  std::unique_ptr<Renderer> renderer_;  // last, since its threads use all of the above
  std::thread loader_thread_;
};

class Bench {
 public:
  Bench(const Options& options, const StoreReader& store, std::vector<CameraSpec> cameras, View view)
      : options_(options), store_(store), cameras_(std::move(cameras)), view_(std::move(view)) {}

  Status Run(nlohmann::json& results) {
    Print(fmt::format("{:>8} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8} {:>8}\n", "mbit/s", "ms", "loading",
                      "cold s", "warm s", "MB", "limit s", "overlap"));
    const std::string no_map = MappedBlocks::WhyNot();
    for (const double mbit : options_.mbits)
      for (const double latency_ms : options_.latencies_ms)
        for (const auto& [name, loading] : {std::pair{"suspend", Walker::Loading::kSuspend},
                                            {"wait", Walker::Loading::kWait},
                                            {"map", Walker::Loading::kMap}}) {
          if (loading == Walker::Loading::kMap && !no_map.empty()) {
            Print(fmt::format("{:8} {:7} {:>8} skipped: {}\n", mbit, latency_ms, name, no_map));
            continue;
          }
          Line line(latency_ms * 1e-3, mbit * 1e6 / 8);
          QUARRY_ASSIGN(nlohmann::json row, Measure(line, loading, mbit * 1e6 / 8));
          row["mbit_per_s"] = mbit;
          row["latency_ms"] = latency_ms;
          row["loading"] = name;
          Print(fmt::format("{:8} {:7} {:>8} {:8.2f} {:8.2f} {:8.1f} {:8.2f} {:8.2f}\n", mbit, latency_ms,
                            name, row["cold_s"].get<double>(), row["warm_s"].get<double>(),
                            row["bytes"].get<double>() / 1e6, row["limit_s"].get<double>(),
                            row["overlap"].get<double>()));
          std::fflush(stdout);
          results.push_back(std::move(row));
        }
    return {};
  }

 private:
  /// The times of the walk, cold and warm, and a lower limit: the sum over frames of the larger of the
  /// processor's time (of the warm frame, and for decoding its new blocks) and the line's time for these
  /// blocks.
  Result<nlohmann::json> Measure(Line& line, Walker::Loading loading, double bytes_per_s) {
    std::unique_ptr<MappedBlocks> mapped;
    if (loading == Walker::Loading::kMap) {
      QUARRY_ASSIGN(mapped, MappedBlocks::Make(store_, line));
    }
    Walker walker(store_, line, loading);
    if (mapped) walker.Publish(mapped->TakeBlocks());
    std::vector<FrameCost> cold, warm;
    QUARRY_ASSIGN(const double cold_s, walker.Walk(view_, cameras_, cold));
    const uint64_t bytes = line.bytes();
    QUARRY_ASSIGN(const double warm_s, walker.Walk(view_, cameras_, warm));
    double compute_s = 0, stored = 0, limit_s = 0;
    for (const FrameCost& frame : warm) compute_s += frame.compute_s;
    for (const FrameCost& frame : cold)
      for (const BlockKey block : frame.blocks) stored += store_.catalog().block(block).stored;
    for (size_t f = 0; f < cold.size(); ++f) {
      double frame_bytes = 0, decode_s = 0;
      for (const BlockKey block : cold[f].blocks) {
        frame_bytes += store_.catalog().block(block).stored;
        if (loading == Walker::Loading::kMap) continue;
        QUARRY_ASSIGN(const double block_s, DecodeSeconds(block));
        decode_s += block_s;
      }
      // Bytes of a mapped file differ from the blocks' bytes: they are divided among frames in proportion.
      frame_bytes *= static_cast<double>(bytes) / stored;
      limit_s += std::max(warm_s * warm[f].compute_s / compute_s + decode_s, frame_bytes / bytes_per_s);
    }
    return nlohmann::json{{"cold_s", cold_s},
                          {"warm_s", warm_s},
                          {"bytes", bytes},
                          {"limit_s", limit_s},
                          {"overlap", limit_s / cold_s}};
  }

  /// The time of decoding, measured once for each block.
  Result<double> DecodeSeconds(BlockKey block) {
    const auto known = decode_s_.find(block);
    if (known != decode_s_.end()) return known->second;
    QUARRY_ASSIGN(const Bytes stored, store_.ReadBlock(block));
    const uint64_t start_us = ThreadTimeUs();
    ResidentBlock resident;
    resident.bytes = *PageBuffer::TryGet(store_.catalog().block(block).decoded);
    QUARRY_TRY(DecodeBlock(store_.catalog(), block, stored, decoder_, resident));
    return decode_s_[block] = static_cast<double>(ThreadTimeUs() - start_us) * 1e-6;
  }

  const Options& options_;
  const StoreReader& store_;
  std::vector<CameraSpec> cameras_;
  View view_;
  BlockDecoder decoder_;
  std::map<BlockKey, double> decode_s_;
};

Status RunBench(const Options& options, nlohmann::json& results) {
  QUARRY_ASSIGN(const StoreReader store, StoreReader::Open(options.store));
  QUARRY_ASSIGN(std::vector<CameraSpec> cameras, ReadCameraPath(options.path));
  View view;
  view.width = options.width;
  view.height = options.height;
  view.mode = options.mode == "whitted" ? RenderMode::kWhitted : RenderMode::kRaycast;
  if (view.mode == RenderMode::kWhitted) view.lights = {DefaultSun(store.catalog().meta.up_axis)};
  view.camera = cameras.front();
  QUARRY_TRY(NormalizeView(view));
  PinToOneCore();
  return Bench(options, store, std::move(cameras), std::move(view)).Run(results);
}

int Main(int argc, char** argv) {
  Options options;
  CLI::App app("A walk with suspended rays, with a loader that is waited for, and through mapped memory.");
  app.add_option("store", options.store, "A store made by quarry-preprocess")->required();
  app.add_option("path", options.path, "Its camera path (JSON)")->required();
  app.add_option("--mbit", options.mbits, "Bandwidths of the line, Mbit/s")
      ->delimiter(',')
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  app.add_option("--latency-ms", options.latencies_ms, "Its latencies, milliseconds")
      ->delimiter(',')
      ->check(CLI::NonNegativeNumber)
      ->capture_default_str();
  app.add_option("--mode", options.mode, "raycast or whitted")
      ->check(CLI::IsMember({"raycast", "whitted"}))
      ->capture_default_str();
  app.add_option("--json", options.json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  nlohmann::json results = nlohmann::json::array();
  const Status status = RunBench(options, results);
  (void)bench::WriteFigures(options.json, results.dump(2));
  if (status) return 0;
  Log(fmt::format("quarry-bench-loading: {}", status.error().message));
  return 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench loading", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}

// How long the master's dispatcher plans a frame and hands out its tiles, and how good the plans are, as
// pictures and clusters grow. A picture of so many tiles is made up: blocks are squares of it, some large,
// most small. A first frame is rendered; then the camera turns a little, and the next frame is predicted,
// planned and handed out.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <deque>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "common/base/log.h"
#include "common/base/number.h"
#include "common/program/run_program.h"
#include "master/schedule/dispatcher.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/stopwatch.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

constexpr double kSecondsPerByte = 8e-8;  // 100 Mbit/s
constexpr uint32_t kBlockBytes = 17000;
constexpr int kBatch = 16;            // results that come between two turns of handing out
constexpr uint32_t kTilesWanted = 4;  // at once, by each worker

/// The blocks that workers hold when the second frame is planned.
enum class Holding { kOwn, kAll, kOne, kNothing };
constexpr std::pair<Holding, const char*> kHoldings[] = {{Holding::kOwn, "what it rendered"},
                                                         {Holding::kAll, "everything"},
                                                         {Holding::kOne, "one has all"},
                                                         {Holding::kNothing, "nothing"}};

View MakeView(uint32_t columns, uint32_t rows, double turned) {
  View view;
  view.width = columns * kTileSize;
  view.height = rows * kTileSize;
  view.camera.at = {std::sin(turned), std::cos(turned), 0};
  view.camera.up = {0, 0, 1};
  if (!NormalizeView(view)) throw std::runtime_error("no such picture");
  return view;
}

/// A master's dispatcher, its workers and its two frames.
class Bench final : FrameSource {
 public:
  Bench(uint32_t columns, uint32_t rows, uint32_t workers)
      : first_(MakeView(columns, rows, 0)), next_(MakeView(columns, rows, 0.02)), workers_(workers) {
    const std::vector<PixelRect> tiles = TilesOf(first_);
    blocks_.resize(tiles.size());
    std::map<std::pair<uint32_t, uint32_t>, size_t> at;
    for (size_t t = 0; t < tiles.size(); ++t) at[{tiles[t].x / kTileSize, tiles[t].y / kTileSize}] = t;
    std::mt19937 random(1);
    std::uniform_real_distribution<double> any(0, 1);
    bytes_.assign(tiles.size() * 3 / 2, kBlockBytes);
    for (uint32_t b = 0; b < bytes_.size(); ++b) {
      const double side = std::exp2(3 * any(random) * any(random)), x = any(random) * columns,
                   y = any(random) * rows;
      for (double r = std::max(0.0, y - side); r < std::min<double>(rows, y + side); ++r)
        for (double c = std::max(0.0, x - side); c < std::min<double>(columns, x + side); ++c)
          blocks_[at[{static_cast<uint32_t>(c), static_cast<uint32_t>(r)}]].push_back(b);
      all_.Set(b, true);
    }
    for (size_t t = 0; t < tiles.size(); ++t)
      cost_us_.push_back(static_cast<uint64_t>(4000 * std::exp2(4 * any(random) - 2)));
  }

  struct Figures {
    std::vector<double> plan_s, hand_out_s, end_s;
    double busiest = 0;        ///< the busiest worker's expected time over the mean
    double fetched_bytes = 0;  ///< expected
  };

  Figures Run(Holding holding, int repetitions) {
    Figures figures;
    for (int r = 0; r < repetitions; ++r) {
      Dispatcher dispatcher(*this, bytes_, SchedulingPolicy::kFootprint, 1);
      dispatcher_ = &dispatcher;
      now_s_ = 0;
      for (uint32_t w = 0; w < workers_.size(); ++w) {
        workers_[w] = {w + 1, 1, kTilesWanted, true, {}, 1};
        dispatcher.AddWorker(workers_[w]);
      }
      if (holding != Holding::kNothing) RenderFirst();
      for (uint32_t w = 0; w < workers_.size(); ++w)
        if (holding != Holding::kOwn) workers_[w].holds.Clear();
      if (holding == Holding::kOne) workers_[0].holds = all_;
      if (holding == Holding::kAll)
        for (WorkerState& worker : workers_) worker.holds = all_;
      // All time beside tracing is decoding: a tile costs its tracing alone.
      dispatcher.SetCosts(kSecondsPerByte, 1e9);
      BeginNext();
      const auto start = Clock::now();
      dispatcher.PlanForWorkers();
      figures.plan_s.push_back(SecondsSince(start));
      if (r == 0) Judge(*dispatcher.Frames().at(0), figures);
      HandOutAll(figures);
    }
    return figures;
  }

 private:
  bool HasNext() const override { return !waiting_.empty(); }
  std::optional<View> Begin(FrameId, double) override {
    if (waiting_.empty()) return std::nullopt;
    return std::exchange(waiting_, {}).front();
  }
  void Probe(std::span<ActiveFrame* const>) override {}
  bool IsNextBeingProbed() const override { return false; }
  void Finish(ActiveFrame& frame, double) override { (void)frame.TakePixels(); }

  /// The tile's result, of the first frame or the next.
  void Answer(const AssignedTile& tile) {
    const TileOrder& order = tile.order;
    TileDone done{order.frame, order.tile, order.lease, 0, 0, cost_us_[order.tile]};
    done.depths.assign(size_t{DepthCells(order.area.pixels.width)} * DepthCells(order.area.pixels.height),
                       10.0f);
    done.blocks = blocks_[order.tile];
    const auto pixels = std::span(pixels_).first(size_t{order.area.pixels.width} * order.area.pixels.height *
                                                 4 * kColorWords);
    if (!dispatcher_->Finish(workers_[tile.worker - 1], done, pixels, now_s_))
      throw std::runtime_error("a tile that does not fit");
  }

  /// Round by round; each worker then holds the blocks of the tiles that it has rendered.
  void RenderFirst() {
    std::vector<BlockSet> own(workers_.size());
    waiting_ = {first_};
    for (auto tiles = dispatcher_->AssignTiles(now_s_); !tiles.empty();
         tiles = dispatcher_->AssignTiles(now_s_)) {
      now_s_ += 1;
      for (const AssignedTile& tile : tiles) {
        for (const uint32_t b : blocks_[tile.order.tile]) own[tile.worker - 1].Set(b, true);
        Answer(tile);
      }
    }
    for (uint32_t w = 0; w < workers_.size(); ++w) workers_[w].holds = std::move(own[w]);
  }

  /// Begins the next frame so that no worker has tiles of it: a frame begins for a worker that has none, here
  /// for one that goes at once.
  void BeginNext() {
    for (WorkerState& worker : workers_) worker.ready = false;
    WorkerState passing{static_cast<uint32_t>(workers_.size()) + 1, 1, kTilesWanted, true, {}, 1};
    dispatcher_->AddWorker(passing);
    waiting_ = {next_};
    (void)dispatcher_->AssignTiles(now_s_);
    dispatcher_->RemoveWorker(passing.id);
    for (WorkerState& worker : workers_) worker.ready = true;
  }

  void Judge(const ActiveFrame& frame, Figures& figures) const {
    std::vector<std::map<uint32_t, float>> fetched(workers_.size());
    std::vector<double> time_s(workers_.size());
    const Snapshot plan = frame.MakeSnapshot({}, 0);
    for (uint32_t t = 0; t < plan.tiles.size(); ++t) {
      const uint32_t w = plan.tiles[t].owner - 1;
      time_s[w] += plan.tiles[t].cost_s;
      const TileFootprint& trace = frame.Expected(t);
      for (size_t i = 0; i < trace.blocks.size(); ++i)
        if (!workers_[w].holds.Has(trace.blocks[i])) {
          float& chance = fetched[w][trace.blocks[i]];
          chance = std::max(chance, trace.chances[i]);
        }
    }
    double sum_s = 0, most_s = 0;
    for (uint32_t w = 0; w < workers_.size(); ++w) {
      for (const auto& [block, chance] : fetched[w]) {
        figures.fetched_bytes += kBlockBytes * static_cast<double>(chance);
        time_s[w] += kBlockBytes * kSecondsPerByte * static_cast<double>(chance);
      }
      sum_s += time_s[w];
      most_s = std::max(most_s, time_s[w]);
    }
    figures.busiest = most_s * static_cast<double>(workers_.size()) / sum_s;
  }

  /// After every few results the dispatcher hands out the free tiles; no other frame begins.
  void HandOutAll(Figures& figures) {
    std::deque<AssignedTile> out;
    const auto hand_out = [&] {
      const auto start = Clock::now();
      auto handed = dispatcher_->AssignTiles(now_s_);
      const double took_s = SecondsSince(start);
      out.insert(out.end(), std::make_move_iterator(handed.begin()), std::make_move_iterator(handed.end()));
      return took_s;
    };
    figures.hand_out_s.push_back(hand_out());
    while (!out.empty()) {
      now_s_ += 1e-3;
      for (int i = 0; i < kBatch && !out.empty(); ++i) {
        Answer(out.front());
        out.pop_front();
      }
      const bool any_idle = out.size() < workers_.size();
      (any_idle ? figures.end_s : figures.hand_out_s).push_back(hand_out());
    }
  }

  const View first_, next_;
  std::vector<WorkerState> workers_;
  std::vector<std::vector<uint32_t>> blocks_;  ///< by tile
  std::vector<uint64_t> cost_us_;              ///< by tile
  std::vector<uint32_t> bytes_;                ///< by block
  BlockSet all_;
  const Bytes pixels_ = Bytes(size_t{kTileSize} * kTileSize * 4 * kColorWords);
  std::vector<View> waiting_;  ///< the frame that may begin
  Dispatcher* dispatcher_ = nullptr;
  double now_s_ = 0;
};

int Main(int argc, char** argv) {
  CLI::App app{"How long a master plans and hands out, and how good its plans are."};
  std::vector<std::string> cases{"20x15x8", "64x64x64", "120x68x256", "120x68x1024"};
  int repetitions = 5;
  std::string json;
  app.add_option("cases", cases, "COLUMNSxROWSxWORKERS each, in tiles")->capture_default_str();
  app.add_option("--repetitions", repetitions)->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--json", json, "Write the figures to this file")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  Print(
      "tiles x workers  each holds         plan ms (spread)     busiest/mean  MB to fetch  hand out ms  "
      "at the end\n");
  nlohmann::ordered_json results;
  for (const std::string& text : cases) {
    uint32_t counts[3] = {0, 0, 0};
    const auto& [columns, rows, workers] = counts;
    if (!ParseCounts(text, "xx", counts) || columns == 0 || columns > 4096 || rows == 0 || rows > 4096 ||
        workers == 0 || workers > 65536) {
      Log(fmt::format("a case is COLUMNSxROWSxWORKERS, not '{}'", text));
      return 2;
    }
    Bench bench(columns, rows, workers);
    for (const auto& [holding, name] : kHoldings) {
      const Bench::Figures f = bench.Run(holding, repetitions);
      const auto [low, high] = std::ranges::minmax(f.plan_s);
      const double end_s = f.end_s.empty() ? 0 : Median(f.end_s);
      Print(fmt::format("{:6} x {:<6}  {:<17} {:7.1f} ({:.1f}-{:.1f}) {:18.2f} {:12.1f} {:12.2f} {:11.2f}\n",
                        columns * rows, workers, name, Median(f.plan_s) * 1e3, low * 1e3, high * 1e3,
                        f.busiest, f.fetched_bytes * 1e-6, Median(f.hand_out_s) * 1e3, end_s * 1e3));
      std::fflush(stdout);
      results.push_back({{"tiles", columns * rows},
                         {"workers", workers},
                         {"holding", name},
                         {"plan_s", Median(f.plan_s)},
                         {"busiest_over_mean", f.busiest},
                         {"fetched_bytes", f.fetched_bytes},
                         {"hand_out_s", Median(f.hand_out_s)},
                         {"hand_out_at_end_s", end_s}});
    }
  }
  return bench::WriteFigures(json, results.dump(2)) ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench plan", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}

// How long a master plans a frame and hands out its tiles, and how good the plans are, as pictures and
// clusters grow. A picture of so many tiles is made up: blocks are squares of it, some large, most small;
// then the camera turns a little, and the next frame is predicted, planned and handed out.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "common/base/number.h"
#include "master/schedule/tile_assignment.h"
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
constexpr int kBatch = 16;   // results that come between two turns of handing out
constexpr double kEndS = 3;  // what has not been handed out by then is left

/// Who holds what when the second frame is planned.
enum class Holding { kOwn, kAll, kOne, kNothing };
constexpr std::pair<Holding, const char*> kHoldings[] = {{Holding::kOwn, "what it rendered"},
                                                         {Holding::kAll, "everything"},
                                                         {Holding::kOne, "one has all"},
                                                         {Holding::kNothing, "nothing"}};

RenderJob MakeJob(uint32_t columns, uint32_t rows, double turned) {
  RenderJob job;
  job.width = columns * kTileSize;
  job.height = rows * kTileSize;
  CameraSpec camera;
  camera.at = {std::sin(turned), std::cos(turned), 0};
  camera.up = {0, 0, 1};
  job.cameras = {camera};
  if (!NormalizeJob(job)) throw std::runtime_error("no such picture");
  return job;
}

class Bench {
 public:
  Bench(uint32_t columns, uint32_t rows, uint32_t workers)
      : workers_(workers),
        first_(1, MakeJob(columns, rows, 0), nullptr),
        next_(MakeJob(columns, rows, 0.02)) {
    const auto& tiles = first_.image().tiles();
    std::vector<std::vector<uint32_t>> blocks(tiles.size());
    std::map<std::pair<uint32_t, uint32_t>, size_t> at;
    for (size_t t = 0; t < tiles.size(); ++t) at[{tiles[t].x / kTileSize, tiles[t].y / kTileSize}] = t;
    std::uniform_real_distribution<double> any(0, 1);
    bytes_.assign(tiles.size() * 3 / 2, kBlockBytes);
    for (uint32_t b = 0; b < bytes_.size(); ++b) {
      const double side = std::exp2(3 * any(random_) * any(random_)), x = any(random_) * columns,
                   y = any(random_) * rows;
      for (double r = std::max(0.0, y - side); r < std::min<double>(rows, y + side); ++r)
        for (double c = std::max(0.0, x - side); c < std::min<double>(columns, x + side); ++c)
          blocks[at[{static_cast<uint32_t>(c), static_cast<uint32_t>(r)}]].push_back(b);
    }
    own_.resize(workers);
    for (uint32_t t = 0; t < tiles.size(); ++t) {
      const auto owner = static_cast<uint32_t>(uint64_t{t} * workers / tiles.size());
      const TileOrder order = first_.Lease({t, owner + 1}, 0);
      TileDone done{1, t, order.lease};
      done.compute_us = static_cast<uint64_t>(4000 * std::exp2(4 * any(random_) - 2));
      done.depths.assign(size_t{DepthCells(order.width)} * DepthCells(order.height), 10.0f);
      done.blocks = blocks[t];
      for (const uint32_t b : blocks[t]) own_[owner].Set(b, true);
      if (!first_.Finish(done, Bytes(size_t{order.width} * order.height * 12), 0))
        throw std::runtime_error("a tile that does not fit");
    }
    for (uint32_t b = 0; b < bytes_.size(); ++b) all_.Set(b, true);
  }

  struct Figures {
    std::vector<double> plan_s, hand_out_s, end_s;
    double busiest = 0;        ///< the busiest worker's expected time over the mean
    double fetched_bytes = 0;  ///< expected
  };

  Figures Run(Holding holding, int repetitions) {
    std::vector<BlockSet> holds(workers_);
    for (uint32_t w = 0; w < workers_; ++w) {
      if (holding == Holding::kOwn) holds[w] = own_[w];
      if (holding == Holding::kAll || (holding == Holding::kOne && w == 0)) holds[w] = all_;
    }
    std::vector<PlannedWorker> planned;
    for (uint32_t w = 0; w < workers_; ++w) planned.push_back({w + 1, 1, 0, &holds[w]});
    Figures figures;
    for (int r = 0; r < repetitions; ++r) {
      ActiveFrame frame(2, next_, holding == Holding::kNothing ? nullptr : &first_);
      if (holding != Holding::kNothing) frame.Foresee(&first_);
      const auto start = Clock::now();
      frame.MakePlan(planned, {bytes_, kSecondsPerByte, 0}, SchedulingPolicy::kFootprint);
      figures.plan_s.push_back(SecondsSince(start));
      if (r == 0) Judge(frame, holds, figures);
      HandOutAll(frame, holds, figures);
    }
    return figures;
  }

 private:
  void Judge(const ActiveFrame& frame, const std::vector<BlockSet>& holds, Figures& figures) const {
    std::vector<std::map<uint32_t, float>> fetched(workers_);
    std::vector<double> time_s(workers_);
    const Snapshot plan = frame.MakeSnapshot({}, 0);
    for (uint32_t t = 0; t < plan.tiles.size(); ++t) {
      const uint32_t w = plan.tiles[t].owner - 1;
      time_s[w] += plan.tiles[t].cost_s;
      const TileFootprint& trace = frame.Expected(t);
      for (size_t i = 0; i < trace.blocks.size(); ++i)
        if (!holds[w].Has(trace.blocks[i])) {
          float& chance = fetched[w][trace.blocks[i]];
          chance = std::max(chance, trace.chances[i]);
        }
    }
    double sum_s = 0, most_s = 0;
    for (uint32_t w = 0; w < workers_; ++w) {
      for (const auto& [block, chance] : fetched[w]) {
        figures.fetched_bytes += kBlockBytes * static_cast<double>(chance);
        time_s[w] += kBlockBytes * kSecondsPerByte * static_cast<double>(chance);
      }
      sum_s += time_s[w];
      most_s = std::max(most_s, time_s[w]);
    }
    figures.busiest = most_s * workers_ / sum_s;
  }

  /// Every few results what is free is handed out; no other frame begins.
  void HandOutAll(ActiveFrame& frame, const std::vector<BlockSet>& holds, Figures& figures) {
    std::vector<WorkerCredit> credits;
    for (uint32_t w = 0; w < workers_; ++w) credits.push_back({w + 1, 4});
    std::deque<AssignedTile> out;
    double now_s = 0;
    const auto hand_out = [&] {
      const auto start = Clock::now();
      auto handed = AssignTiles(
          {&frame}, credits, now_s, true,
          [&](const ActiveFrame& f, uint32_t tile, uint32_t worker) {
            return ExpectedBytes(f.Expected(tile), holds[worker - 1], bytes_) * kSecondsPerByte;
          },
          [] { return nullptr; });
      out.insert(out.end(), handed.begin(), handed.end());
      return SecondsSince(start);
    };
    figures.hand_out_s.push_back(hand_out());
    const Bytes pixels(size_t{kTileSize} * kTileSize * 12);
    const auto begun = Clock::now();
    while (!frame.done() && !out.empty() && SecondsSince(begun) < kEndS) {
      for (int i = 0; i < kBatch && !out.empty(); ++i) {
        const TileOrder order = out.front().order;
        out.pop_front();
        TileDone done{2, order.tile, order.lease};
        (void)frame.Finish(done, std::span(pixels).first(size_t{order.width} * order.height * 12), now_s);
      }
      now_s += 1e-3;
      const bool any_idle = out.size() < credits.size();
      (any_idle ? figures.end_s : figures.hand_out_s).push_back(hand_out());
    }
  }

  const uint32_t workers_;
  ActiveFrame first_;
  const RenderJob next_;
  std::vector<uint32_t> bytes_;
  std::vector<BlockSet> own_;
  BlockSet all_;
  std::mt19937 random_{1};
};

int Main(int argc, char** argv) {
  CLI::App app{"How long a master plans and hands out, and how good its plans are."};
  std::vector<std::string> cases{"20x15x8", "64x64x64", "120x68x256", "120x68x1024"};
  int repetitions = 5;
  std::string json;
  app.add_option("cases", cases, "COLUMNSxROWSxWORKERS each, in tiles")->capture_default_str();
  app.add_option("--repetitions", repetitions)->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--json", json, "Write the figures to this file")->check(bench::CheckFigures);
  CLI11_PARSE(app, argc, argv);
  fmt::print(
      "tiles x workers  each holds         plan ms (spread)     busiest/mean  MB to fetch  hand out ms  "
      "at the end\n");
  nlohmann::ordered_json results;
  for (const std::string& text : cases) {
    uint32_t counts[3] = {0, 0, 0};
    const auto& [columns, rows, workers] = counts;
    if (!ParseCounts(text, "xx", counts) || columns == 0 || columns > 4096 || rows == 0 || rows > 4096 ||
        workers == 0 || workers > 65536) {
      fmt::print(stderr, "a case is COLUMNSxROWSxWORKERS, not '{}'\n", text);
      return 2;
    }
    Bench bench(columns, rows, workers);
    for (const auto& [holding, name] : kHoldings) {
      const Bench::Figures f = bench.Run(holding, repetitions);
      const auto [low, high] = std::ranges::minmax(f.plan_s);
      const double end_s = f.end_s.empty() ? 0 : Median(f.end_s);
      fmt::print("{:6} x {:<6}  {:<17} {:7.1f} ({:.1f}-{:.1f}) {:18.2f} {:12.1f} {:12.2f} {:11.2f}\n",
                 columns * rows, workers, name, Median(f.plan_s) * 1e3, low * 1e3, high * 1e3, f.busiest,
                 f.fetched_bytes * 1e-6, Median(f.hand_out_s) * 1e3, end_s * 1e3);
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

int main(int argc, char** argv) { return quarry::bench::Main(argc, argv); }

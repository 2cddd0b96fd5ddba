// The family's kernels on a GPU: their hits against the CPU's to the last bit, then millions of rays a
// second. Runs on a machine without Quarry's libraries (bare_libraries.cpp). Status 77: there is no device.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/base/log.h"
#include "common/base/resource.h"
#include "common/program/run_program.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/gpu/gpu_check.h"
#include "tests/bench/gpu/gpu_scene.h"
#include "tests/bench/median.h"
#include "tests/bench/rays/ray_sets.h"
#include "tests/bench/views.h"

namespace quarry::bench {
namespace {

constexpr int kNoDevice = 77;

/// The measurements of a store, after its check.
enum class Measured { kNothing, kFrame, kRays };

struct Options {
  std::vector<std::string> stores, frames, checks, interior;
  uint64_t rays = 10'000'000;
  double check_seconds = 15;
  uint32_t batch = 8192, size = 1024, frame_size = 512;
  int repetitions = 5;
  std::string json;
};

using nlohmann::json;

double PerSecond(uint64_t rays, double seconds) { return static_cast<double>(rays) / seconds / 1e6; }

/// Seconds of the device for the chosen rays: the median of `repetitions`, after one that is not counted.
Result<double> TimeOf(int repetitions, cuda::DeviceRays& rays, const std::function<Result<double>()>& trace) {
  std::vector<double> times;
  for (int r = 0; r <= repetitions; ++r) {
    QUARRY_TRY(rays.Reset());
    QUARRY_ASSIGN(const double seconds, trace());
    if (r > 0) times.push_back(seconds);
  }
  return Median(times);
}

/// Bytes that a ray's steps load, caches or not, by the counts of the same steps on the CPU. Climbs count one
/// treelet's header each; of triangles that the filter drops the id is not counted.
double BytesARay(const GpuWay& way, const TraceStatistics& s) {
  if (s.rays == 0) return 0;
  const bool wide = way.way == cuda::DeviceWay::kWide, ropes = way.way == cuda::DeviceWay::kRopes;
  const double node = wide ? sizeof(float) * 6 * WideNode::kChildren : sizeof(KdNode);
  const double leaf = wide ? sizeof(uint32_t) + sizeof(uint16_t) + 3 * sizeof(float)
                           : sizeof(KdNode) + (ropes ? sizeof(RopeLeaf) : 0);
  const double climb = wide                                 ? sizeof(uint32_t) + 3 * sizeof(float)
                       : way.way == cuda::DeviceWay::kClimb ? sizeof(TreeletHeader)
                                                            : 0;
  constexpr double kTriangle = sizeof(uint16_t) * 4 + sizeof(float) * 9, kExact = sizeof(uint32_t);
  constexpr double kVoxel = sizeof(VoxelBounds) + sizeof(VoxelGeometry);
  const double bytes =
      node * static_cast<double>(s.node_steps) + leaf * static_cast<double>(s.leaves) +
      climb * static_cast<double>(s.climbs) + kTriangle * static_cast<double>(s.triangle_tests) +
      kExact * static_cast<double>(s.exact_tests) + kVoxel * static_cast<double>(s.voxel_visits);
  return bytes / static_cast<double>(s.rays);
}

/// Counts the steps of every 16th packet on the CPU.
TraceStatistics CountSteps(GpuScene& scene, const GpuWay& way, const RaySet& set) {
  TraceStatistics statistics;
  const Variant& kernel = CpuKernelOf(way);
  const auto counted = set.any ? kernel.counted_any : kernel.counted_closest;
  for (size_t p = 0; p < set.packets.size(); p += 16) {
    RayPacket packet = set.packets[p];
    counted(scene.view(way).top(), scene.view(way).finder(), &packet, &set.active[p], 1, statistics);
  }
  return statistics;
}

class GpuBench {
 public:
  GpuBench(const Options& options, json& results) : options_(options), results_(results) {}

  Status DescribeDevice() {
    QUARRY_ASSIGN(const cuda::DeviceInfo info, cuda::FindDevice());
    QUARRY_ASSIGN(const double copies, cuda::MeasureBandwidth());
    Print(fmt::format(
        "{}: compute capability {}.{}, {} multiprocessors, {:.1f} GB, memory {:.0f} GB/s by its clock, "
        "{:.0f} GB/s measured by copies; CUDA {}.{}, driver for {}.{}; {} processors\n\n",
        info.name, info.major, info.minor, info.multiprocessors, static_cast<double>(info.memory_bytes) / 1e9,
        info.bandwidth_bytes_per_s / 1e9, copies / 1e9, info.runtime / 1000, info.runtime % 1000 / 10,
        info.driver / 1000, info.driver % 1000 / 10, UsableProcessors()));
    results_["device"] = {{"name", info.name},
                          {"multiprocessors", info.multiprocessors},
                          {"memory_bytes", info.memory_bytes},
                          {"clock_bandwidth_bytes_per_s", info.bandwidth_bytes_per_s},
                          {"copy_bandwidth_bytes_per_s", copies},
                          {"processors", UsableProcessors()}};
    return {};
  }

  Status DescribeKernels() {
    Print(
        "| kernel | schedule | hits | registers | local bytes | warps a multiprocessor "
        "|\n|---|---|---|---|---|---|\n");
    for (const GpuWay& way : kGpuWays) {
      // The kernel of restart and backtrack is that of treelets.
      if (way.way == cuda::DeviceWay::kClimb && way.layout != test::TreeLayout::kTreelets) continue;
      for (const cuda::Schedule schedule : kSchedules)
        for (const bool any : {false, true}) {
          QUARRY_ASSIGN(const cuda::KernelFacts facts, cuda::FactsOf({way.way, schedule, any, {}}));
          Print(fmt::format("| {} | {} | {} | {} | {} | {} |\n", way.name, Name(schedule),
                            any ? "any" : "closest", facts.registers, facts.local_bytes, facts.warps));
          results_["kernels"].push_back({{"way", way.name},
                                         {"schedule", Name(schedule)},
                                         {"any", any},
                                         {"registers", facts.registers},
                                         {"local_bytes", facts.local_bytes},
                                         {"warps", facts.warps}});
        }
    }
    Print("\n");
    return {};
  }

  Status RunStore(const std::string& path, Measured measured) {
    const auto start = std::chrono::steady_clock::now();
    name_ = std::filesystem::path(path).stem().string();
    QUARRY_ASSIGN(const auto scene, GpuScene::Load(path, measured == Measured::kNothing));
    const SceneMeta& meta = scene->resident().catalog().meta;
    Print(fmt::format("{}: {} triangles, {} voxels, loaded in {:.1f} s\n", name_, meta.input_triangles,
                      scene->resident().voxels().size(), SecondsSince(start)));
    QUARRY_TRY(CheckStore(*scene));
    const bool interior = std::ranges::count(options_.interior, name_) != 0;
    QUARRY_ASSIGN(const CameraSpec view, FindView(path, meta, interior));
    if (measured == Measured::kFrame) QUARRY_TRY(MeasureFrame(*scene, view));
    if (measured == Measured::kRays) QUARRY_TRY(MeasureRays(*scene, view));
    Print(fmt::format("  {:.1f} s in all\n\n", SecondsSince(start)));
    std::fflush(stdout);
    return {};
  }

  bool sound() const { return sound_; }

 private:
  Status CheckStore(GpuScene& scene) {
    QUARRY_ASSIGN(const GpuCheck check,
                  CheckOnDevice(scene, options_.rays, options_.check_seconds, options_.batch));
    Print(
        fmt::format("  check: {} random rays, {} hits, {} times through kernels, {} waits: {} differences\n",
                    check.rays, check.hits, check.traced, check.suspended, check.differences));
    for (const std::string& difference : check.first) Print(fmt::format("    {}\n", difference));
    results_["checks"].push_back({{"scene", name_},
                                  {"rays", check.rays},
                                  {"hits", check.hits},
                                  {"traced", check.traced},
                                  {"suspended", check.suspended},
                                  {"differences", check.differences}});
    sound_ = sound_ && check.differences == 0;
    return {};
  }

  Status MeasureRays(GpuScene& scene, const CameraSpec& view) {
    const std::vector<RaySet> sets = MakeRaySets(scene.resident(), options_.size, view);
    Print(fmt::format("\n| {} | schedule |", name_));
    for (const RaySet& set : sets) Print(fmt::format(" {} |", set.name));
    Print(" bytes a bounce | GB/s |\n|---|---|---|---|---|---|---|---|\n");
    QUARRY_ASSIGN(cuda::DeviceRays rays,
                  cuda::DeviceRays::Make(static_cast<uint32_t>(sets[0].packets.size())));
    for (const GpuWay& way : kGpuWays) QUARRY_TRY(MeasureWay(scene, way, sets, rays));
    MeasureCpu(scene, sets);
    return MeasureLimits(scene, sets, rays);
  }

  Status Choose(const RaySet& set, cuda::DeviceRays& rays) {
    QUARRY_TRY(rays.Put(set.packets));
    return rays.Choose(ListRays(set.active.data(), static_cast<uint32_t>(set.active.size())));
  }

  /// A row for each schedule. Bytes and bandwidth are of the last kind of rays, the bounces.
  Status MeasureWay(GpuScene& scene, const GpuWay& way, const std::vector<RaySet>& sets,
                    cuda::DeviceRays& rays) {
    std::vector<double> bytes_of;
    for (const RaySet& set : sets) bytes_of.push_back(BytesARay(way, CountSteps(scene, way, set)));
    for (const cuda::Schedule schedule : kSchedules) {
      Print(fmt::format("| {} | {} |", way.name, Name(schedule)));
      double bytes = 0, speed = 0;
      for (const RaySet& set : sets) {
        if (set.rays == 0) continue;
        QUARRY_TRY(Choose(set, rays));
        QUARRY_ASSIGN(const double seconds, TimeOf(options_.repetitions, rays, [&] {
                        return cuda::Trace(scene.device(way), rays, {way.way, schedule, set.any, {}});
                      }));
        bytes = bytes_of[static_cast<size_t>(&set - sets.data())];
        speed = PerSecond(set.rays, seconds);
        Print(fmt::format(" {:.1f} |", speed));
        results_["speeds"].push_back({{"scene", name_},
                                      {"way", way.name},
                                      {"schedule", Name(schedule)},
                                      {"ray", set.name},
                                      {"rays", set.rays},
                                      {"mrays_per_s", speed},
                                      {"bytes_a_ray", bytes}});
      }
      Print(fmt::format(" {:.0f} | {:.0f} |\n", bytes, bytes * speed / 1e3));
    }
    return {};
  }

  /// The rule of renders, on one processor and on all.
  void MeasureCpu(GpuScene& scene, const std::vector<RaySet>& sets) {
    const test::SceneView& view = scene.resident().view();
    for (const bool all : {false, true}) {
      Print(fmt::format("| CPU, rule of renders | {} |",
                        all ? fmt::format("{} processors", UsableProcessors()) : "one processor"));
      for (const RaySet& set : sets) {
        if (set.rays == 0) continue;
        const TraceFunction trace = set.any ? AnyByRule : ClosestByRule;
        std::vector<double> times;
        for (int r = 0; r < (all ? options_.repetitions : 1) + 1; ++r) {
          std::vector<RayPacket> packets = set.packets;
          const auto start = std::chrono::steady_clock::now();
          if (all)
            TraceInParallel(view, trace, packets, set.active);
          else
            trace(view.top(), view.finder(), packets.data(), set.active.data(),
                  static_cast<uint32_t>(packets.size()));
          if (r > 0) times.push_back(SecondsSince(start));
        }
        const double speed = PerSecond(set.rays, Median(times));
        Print(fmt::format(" {:.2f} |", speed));
        results_["cpu"].push_back({{"scene", name_},
                                   {"processors", all ? UsableProcessors() : 1},
                                   {"ray", set.name},
                                   {"mrays_per_s", speed}});
      }
      Print(" | |\n");
    }
  }

  static void ClosestByRule(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                            const uint64_t* active, uint32_t count) {
    TraceRays(top, finder, packets, active, count, false);
  }
  static void AnyByRule(const TopTree& top, const VoxelFinder& finder, RayPacket* packets,
                        const uint64_t* active, uint32_t count) {
    TraceRays(top, finder, packets, active, count, true);
  }

  /// When warps take new rays, and when lanes at nodes wait: the limits of WarpLimits are chosen by this.
  Status MeasureLimits(GpuScene& scene, const std::vector<RaySet>& sets, cuda::DeviceRays& rays) {
    Print(fmt::format("\n| {}, persistent | refill below | few at nodes |", name_));
    for (const RaySet& set : sets) Print(fmt::format(" {} |", set.name));
    Print("\n|---|---|---|---|---|---|---|\n");
    for (const GpuWay& way : kGpuWays) {
      if (way.way != cuda::DeviceWay::kRopes && way.way != cuda::DeviceWay::kWide) continue;
      for (const WarpLimits limits : {WarpLimits{1, 0},
                                      {8, 0},
                                      {16, 0},
                                      {20, 0},
                                      {24, 0},
                                      {28, 0},
                                      {32, 0},
                                      {20, 4},
                                      {20, 8},
                                      {20, 16},
                                      {28, 8}}) {
        Print(fmt::format("| {} | {} | {} |", way.name, limits.refill_below, limits.few_at_nodes));
        for (const RaySet& set : sets) {
          if (set.rays == 0) continue;
          QUARRY_TRY(Choose(set, rays));
          QUARRY_ASSIGN(const double seconds, TimeOf(3, rays, [&] {
                          return cuda::Trace(scene.device(way), rays,
                                             {way.way, cuda::Schedule::kPersistent, set.any, limits});
                        }));
          Print(fmt::format(" {:.1f} |", PerSecond(set.rays, seconds)));
          results_["limits"].push_back({{"scene", name_},
                                        {"way", way.name},
                                        {"refill_below", limits.refill_below},
                                        {"few_at_nodes", limits.few_at_nodes},
                                        {"ray", set.name},
                                        {"mrays_per_s", PerSecond(set.rays, seconds)}});
        }
        Print("\n");
      }
    }
    return {};
  }

  /// Foley & Sugerman 2005, table 1: milliseconds a frame of primary rays.
  Status MeasureFrame(GpuScene& scene, const CameraSpec& view) {
    const RaySet primary = std::move(MakeRaySets(scene.resident(), options_.frame_size, view)[0]);
    QUARRY_ASSIGN(cuda::DeviceRays rays,
                  cuda::DeviceRays::Make(static_cast<uint32_t>(primary.packets.size())));
    QUARRY_TRY(Choose(primary, rays));
    Print(fmt::format(
        "  {0} x {0} primary rays, {1} of them meet the scene's box\n\n| {2} | schedule | ms a frame "
        "|\n|---|---|---|\n",
        options_.frame_size, primary.rays, name_));
    for (const GpuWay& way : kGpuWays)
      for (const cuda::Schedule schedule : kSchedules) {
        QUARRY_ASSIGN(const double seconds, TimeOf(options_.repetitions, rays, [&] {
                        return cuda::Trace(scene.device(way), rays, {way.way, schedule, false, {}});
                      }));
        Print(fmt::format("| {} | {} | {:.3f} |\n", way.name, Name(schedule), seconds * 1e3));
        results_["frames"].push_back({{"scene", name_},
                                      {"way", way.name},
                                      {"schedule", Name(schedule)},
                                      {"ms_a_frame", seconds * 1e3}});
      }
    return {};
  }

  const Options& options_;
  json& results_;
  std::string name_;
  bool sound_ = true;
};

Status RunAll(const Options& options, GpuBench& bench, const json& results) {
  const auto run = [&](const std::vector<std::string>& stores, Measured measured) -> Status {
    for (const std::string& store : stores) {
      QUARRY_TRY(bench.RunStore(store, measured));
      // After every scene, so that an end before the last scene loses no figures.
      (void)WriteFigures(options.json, results.dump(2));
    }
    return {};
  };
  QUARRY_TRY(bench.DescribeDevice());
  QUARRY_TRY(bench.DescribeKernels());
  QUARRY_TRY(run(options.checks, Measured::kNothing));
  QUARRY_TRY(run(options.frames, Measured::kFrame));
  return run(options.stores, Measured::kRays);
}

int Main(int argc, char** argv) {
  Options options;
  CLI::App app("The family's kernels on a GPU: checked against the CPU, then measured.");
  app.add_option("store", options.stores, "Stores made by quarry-preprocess: millions of rays a second");
  app.add_option("--frames", options.frames, "Stores: milliseconds a frame")->allow_extra_args();
  app.add_option("--checks", options.checks, "Stores that are checked, with opacity masks, not measured")
      ->allow_extra_args();
  app.add_option("--interior", options.interior, "Names of stores that are seen from inside the box")
      ->allow_extra_args();
  app.add_option("--rays", options.rays, "Random rays to check, of each store")->capture_default_str();
  app.add_option("--check-seconds", options.check_seconds, "Time for the check of each store")
      ->capture_default_str();
  app.add_option("--batch", options.batch, "Packets of 64 rays to check at a time")
      ->check(CLI::Range(1, 1 << 20))
      ->capture_default_str();
  app.add_option("--size", options.size, "Pixels on a side, a multiple of 8")
      ->check(CLI::Range(8, 16384))
      ->capture_default_str();
  app.add_option("--frame-size", options.frame_size, "The same of --frames")
      ->check(CLI::Range(8, 16384))
      ->capture_default_str();
  app.add_option("--repetitions", options.repetitions, "Medians of so many")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--json", options.json, "Results as JSON")->check(CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  if (options.size % RayPacket::kSide != 0 || options.frame_size % RayPacket::kSide != 0) {
    Log("quarry-gpu-bench: --size, --frame-size: not a multiple of 8");
    return 2;
  }
  if (const auto device = cuda::FindDevice(); !device) {
    Log(fmt::format("quarry-gpu-bench: nothing is measured: {}", device.error().message));
    return kNoDevice;
  }
  // Line by line: the figures before a kernel that never ends are seen.
  std::setvbuf(stdout, nullptr, _IOLBF, BUFSIZ);
  json results;
  GpuBench bench(options, results);
  const Status status = RunAll(options, bench, results);
  (void)WriteFigures(options.json, results.dump(2));
  if (!status) Log(fmt::format("quarry-gpu-bench: {}", status.error().message));
  if (!bench.sound()) Log("quarry-gpu-bench: the device and the CPU disagree");
  return status && bench.sound() ? 0 : 1;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-gpu-bench", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}

// Runs the walks of `quarry bench simulate` and prints their results: see simulation.h.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/program/run_program.h"
#include "tests/bench/figures.h"
#include "tests/scalability/simulation.h"

namespace quarry {
namespace {

using Json = nlohmann::json;

struct SimulatorOptions {
  std::string store, trace, json, foresight = "256M";
  std::vector<unsigned> workers{1, 2, 4, 8};
  unsigned frames = 0, step = 1;
  SimulatedCluster cluster;
};

/// Also prints the time that it takes on this machine.
Result<Foreseen> Foresee(const Scene& scene, uint64_t cache_bytes, const TracedWalk& walk) {
  Foreseen foreseen;
  if (cache_bytes == 0) return foreseen;
  QUARRY_ASSIGN(
      const auto renderer,
      Renderer::Create(scene, {std::max<uint64_t>(cache_bytes, scene.catalog().meta.largest_decoded), 1}));
  const auto start = std::chrono::steady_clock::now();
  for (const View& view : walk.views) {
    QUARRY_ASSIGN(ProbedFrame frame, ProbeFrame(*renderer, view));
    foreseen.push_back(std::make_shared<const ProbedFrame>(std::move(frame)));
  }
  Print(
      fmt::format("coarse rays: {:.1f} ms a frame\n", 1e3 * SecondsSince(start) / double(walk.views.size())));
  return foreseen;
}

Status Run(const SimulatorOptions& o) {
  QUARRY_TRY(ParsePolicy(o.cluster.policy));
  QUARRY_TRY(ParseLoading(o.cluster.loading));
  QUARRY_TRY(ParseSize(o.cluster.cache, "--cache"));
  QUARRY_ASSIGN(const Scene scene, Scene::Open(o.store));
  QUARRY_ASSIGN(const TracedWalk walk, ReadTracedWalk(o.trace, scene.catalog(), o.step, o.frames));
  std::vector<uint32_t> bytes;
  for (uint32_t number = 0; number < scene.catalog().block_numbers(); ++number) {
    const std::optional<BlockKey> block = scene.catalog().BlockOf(number);
    bytes.push_back(block ? scene.catalog().block(*block).stored : 0);
  }
  std::set<uint32_t> touched;
  for (const auto& frame : walk.tiles)
    for (const auto& tile : frame) touched.insert(tile.blocks.begin(), tile.blocks.end());
  uint64_t touched_bytes = 0;
  for (const uint32_t b : touched) touched_bytes += bytes[b];
  Print(fmt::format("{} frames of {} tiles, {:.1f} MB touched\n", walk.views.size(), walk.tiles[0].size(),
                    touched_bytes * 1e-6));
  QUARRY_ASSIGN(const uint64_t foresight_bytes, ParseSize(o.foresight, "--foresight"));
  QUARRY_ASSIGN(const Foreseen foreseen, Foresee(scene, foresight_bytes, walk));
  Print(
      "workers  seconds  speed-up  MB loaded  from peers  processors busy  busiest server  overlap  foreseen "
      " "
      "fulfilled  ms planning a frame\n");
  Json rows = Json::array();
  double one_s = 0;
  for (const unsigned workers : o.workers) {
    Simulation simulation(o.cluster, walk, foreseen, scene.catalog(), bytes, workers);
    const double s = simulation.Run();
    if (one_s == 0) one_s = s * workers;  // estimate from the first count when that is not 1
    Print(fmt::format(
        "{:7}  {:7.2f}  {:8.2f}  {:9.1f}  {:10.1f}  {:14.0f}%  {:13.0f}%  {:7.2f}  {:7.0f}%  {:8.0f}%  "
        "{:19.1f}\n",
        workers, s, one_s / s, simulation.bytes() * 1e-6, simulation.peer_bytes() * 1e-6,
        100 * simulation.compute_s() / workers / s, 100 * simulation.server_busy_s() / s,
        simulation.least_s() / s, 100 * simulation.foreseen(), 100 * simulation.fulfilled(),
        1e3 * simulation.planning_s()));
    rows.push_back({{"workers", workers},
                    {"servers", o.cluster.servers},
                    {"peers", o.cluster.peers},
                    {"policy", o.cluster.policy},
                    {"loading", o.cluster.loading},
                    {"seconds", s},
                    {"overlap", simulation.least_s() / s},
                    {"voxel_bytes_received", simulation.bytes()},
                    {"voxel_bytes_from_peer", simulation.peer_bytes()},
                    {"planning_s_a_frame", simulation.planning_s()},
                    {"touched_bytes", touched_bytes}});
  }
  if (o.json.empty()) return {};
  return WriteFileAtomically(o.json, AsBytes(rows.dump(2) + "\n"));
}

int Main(int argc, char** argv) {
  SimulatorOptions o;
  SimulatedCluster& c = o.cluster;
  CLI::App app{"Runs the real scheduler, source and cache policies on a traced walk in simulated time."};
  app.footer(
      "Example:\n  quarry bench simulate plant.quarry walk.trace --workers 1,8,64,256 --servers 4 --peers");
  app.add_option("store", o.store, "The scene store")->required();
  app.add_option("trace", o.trace, "What quarry-master --trace wrote")->required();
  app.add_option("--workers", o.workers, "Worker counts, one run each")
      ->delimiter(',')
      ->capture_default_str();
  app.add_option("--servers", c.servers, "Voxel servers")->check(CLI::Range(1, 64))->capture_default_str();
  app.add_flag("--peers", c.peers, "Workers serve each other");
  app.add_flag("--planning", c.planning,
               "Planning keeps the master busy for as long as it takes here: no two runs are the same");
  app.add_flag("--warm", c.warm, "Time the walk's second pass");
  app.add_option("--schedule", c.policy, "footprint, last-owner or random")->capture_default_str();
  app.add_option("--loading", c.loading,
                 "What a worker does while a voxel comes: suspend (goes on with other rays), wait (nothing), "
                 "map (nothing, and voxels are decoded bytes of a file mapped over the network)")
      ->capture_default_str();
  app.add_option("--cache", c.cache, "Each worker's")->capture_default_str();
  app.add_option("--foresight", o.foresight, "The master's, for coarse rays; 0: none are sent")
      ->capture_default_str();
  app.add_option("--worker-mbit", c.worker_mbit, "Each worker's link")->capture_default_str();
  app.add_option("--server-mbit", c.server_mbit, "Each server's link")->capture_default_str();
  app.add_option("--share", c.share, "Each worker's part of the core that the trace was made on")
      ->capture_default_str();
  app.add_option("--decode", c.decode_gb_s, "Decoding, GB of decoded bytes a second on a whole core")
      ->capture_default_str();
  app.add_option("--latency", c.latency_s, "Seconds from a request to its answer's first byte")
      ->capture_default_str();
  app.add_option("--tile-us", c.tile_us, "Microseconds of the master for each message about a tile")
      ->capture_default_str();
  app.add_option("--overhead-us", c.overhead_us,
                 "Microseconds of a whole core that a tile costs a worker beside tracing")
      ->capture_default_str();
  app.add_option("--waves", c.waves, "In how many steps rays come to a tile's blocks")->capture_default_str();
  app.add_option("--frames", o.frames, "Only the first so many");
  app.add_option("--step", o.step, "Only every so many-th frame: a faster walk")->capture_default_str();
  app.add_option("--json", o.json, "Write the figures to this file")->check(bench::CheckFigures);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& e) {
    return app.exit(e) == 0 ? 0 : 2;
  }
  const Status status = Run(o);
  if (status) return 0;
  Log(fmt::format("quarry-bench-simulate: {}", status.error().message));
  return status.error().exit_status();
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench simulate", "figures that were printed stand"}, argc, argv,
                            quarry::Main);
}

// `quarry bench papers`: the tables of Foley & Sugerman 2005 on this machine, as Markdown, beside theirs.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/base/log.h"
#include "common/program/run_program.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/cuda/trace_cuda.h"
#include "tests/laboratory/tables/kernel_costs.h"
#include "tests/laboratory/tables/papers_device.h"
#include "tests/laboratory/variants/simt.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::laboratory {
namespace {

struct Options {
  std::vector<std::string> stores;
  std::string folder, json, instructions;
  uint32_t size = 512;
  int repetitions = 3;
  size_t calls = 1000000;
  bool no_brute_force = false;
};

double Millions(uint64_t count) { return static_cast<double>(count) / 1e6; }
double Ratio(uint64_t a, uint64_t b) {
  return static_cast<double>(a) / static_cast<double>(std::max<uint64_t>(b, 1));
}

/// The paper's figure, or nothing where it tells none.
std::string Theirs(double figure) { return figure > 0 ? fmt::format("{:.2f}", figure) : "-"; }

/// The measurements of a scene, kept after the scene itself is freed.
struct Measured {
  std::string name;
  const PaperFigures* paper;
  uint64_t triangles, rays, grid_references;
  GridResolution cells;
  std::vector<Timing> timings;
  std::optional<Result<DeviceTimes>> on_device;  ///< none without a GPU
  FrameCounts grid;
  std::vector<TreeCounts> trees;
  std::vector<KernelCost> kernels;  ///< of the kitchen alone
};

bool IsKitchen(const PapersScene& scene) {
  return scene.paper() && std::string_view(scene.paper()->name) == "Kitchen";
}

/// Repetitions on a GPU are so many times as many, because a frame takes less than a millisecond there.
constexpr int kDeviceRepetitions = 10;

/// `gpu`: there is one. A fault of the GPU keeps the processor's figures.
Result<Measured> Measure(const std::string& store, const Options& options, bool gpu) {
  QUARRY_ASSIGN(const auto scene, PapersScene::Load(store, options.size));
  Measured m{.name = scene->name(),
             .paper = scene->paper(),
             .triangles = scene->scene().triangles().size(),
             .rays = scene->rays(),
             .grid_references = scene->grid().references(),
             .cells = scene->grid().resolution()};
  QUARRY_ASSIGN(m.timings, scene->Time(options.repetitions, !options.no_brute_force));
  if (gpu)
    m.on_device = TimeOnDevice(*scene, kDeviceRepetitions * options.repetitions, !options.no_brute_force);
  QUARRY_ASSIGN(m.trees, scene->CountTrees());
  QUARRY_ASSIGN(m.grid, scene->CountGrid());
  if (IsKitchen(*scene)) m.kernels = MeasureKernels(*scene, options.repetitions, options.calls);
  return m;
}

void PrintScenes(const std::vector<Measured>& all) {
  Print(
      "Scenes\n\n| scene | triangles | paper's | rays into the box | grid | references in the grid |\n"
      "|---|---|---|---|---|---|\n");
  for (const Measured& m : all) {
    const GridResolution& n = m.cells;
    Print(fmt::format("| {} | {} | {} | {} | {}x{}x{} | {} |\n", m.name, m.triangles,
                      m.paper ? std::to_string(m.paper->triangles) : "-", m.rays, n[0], n[1], n[2],
                      m.grid_references));
  }
  Print(
      "\n| scene | tree | splits | leaves | depth | references | built or read, s "
      "|\n|---|---|---|---|---|---|---|\n");
  for (const Measured& m : all)
    for (const TreeCounts& tree : m.trees)
      Print(fmt::format("| {} | {} | {} | {} | {} | {} | {:.2f} |\n", m.name, tree.name, tree.splits,
                        tree.leaves, tree.depth, tree.references, tree.build_seconds));
}

/// Milliseconds by the names of structures; 0: not measured.
class Milliseconds {
 public:
  explicit Milliseconds(const std::vector<Timing>& timings) : timings_(timings) {}
  double Of(std::string_view name) const {
    const auto found = std::ranges::find(timings_, name, &Timing::name);
    return found == timings_.end() ? 0 : bench::Median(found->seconds) * 1e3;
  }
  std::string Cells(std::initializer_list<const char*> names, int digits) const {
    std::string cells;
    for (const char* name : names) cells += Cell(Of(name), digits);
    return cells;
  }
  /// The ratios of table 1.
  std::string Ratios() const {
    const double restart = Of("restart");
    return Cell(Of("brute") / restart, 2) + Cell(Of("grid") / restart, 2) +
           Cell(restart / Of("backtrack"), 2);
  }

 private:
  static std::string Cell(double value, int digits) {
    return value > 0 ? fmt::format(" {:.{}f} |", value, digits) : " - |";
  }
  const std::vector<Timing>& timings_;
};

void PrintTable1(const std::vector<Measured>& all) {
  Print(fmt::format(
      "\nTable 1: processor milliseconds a frame, median; {}, one core; the paper's on an ATI X800 XT PE. "
      "The last columns: the tree as ours\n\n| scene | | brute | grid | restart | backtrack | brute / "
      "restart | grid / restart | restart / backtrack | restart, ours | backtrack, ours |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|\n",
      BestSimt().isa));
  for (const Measured& m : all) {
    const Milliseconds ms(m.timings);
    Print(fmt::format("| {} | here |{}{}{}\n", m.name, ms.Cells({"brute", "grid", "restart", "backtrack"}, 1),
                      ms.Ratios(), ms.Cells({"restart, ours", "backtrack, ours"}, 1)));
    if (const PaperFigures* p = m.paper)
      Print(
          fmt::format("| | paper | {:.0f} | {:.0f} | {:.0f} | {:.0f} | {:.2f} | {:.2f} | {:.2f} | - | - |\n",
                      p->brute, p->grid_ms, p->restart, p->backtrack, p->brute / p->restart,
                      p->grid_ms / p->restart, p->restart / p->backtrack));
  }
  Print(
      "\nCounts a ray: what the grid and kd-restart over their tree do\n\n| scene | grid: cells | lists | "
      "tests "
      "| restart: down | leaves | tests |\n|---|---|---|---|---|---|---|\n");
  for (const Measured& m : all) {
    const auto a_ray = [&](uint64_t n) { return Ratio(n, m.rays); };
    const TraceCounts& kd = m.trees[0].restart;
    Print(fmt::format("| {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n", m.name,
                      a_ray(m.grid.steps), a_ray(m.grid.lists), a_ray(m.grid.tests), a_ray(kd.steps),
                      a_ray(kd.leaves()), a_ray(kd.tests)));
  }
}

/// `device`: its name, or why nothing is measured.
void PrintDevice(const std::vector<Measured>& all, const Result<cuda::DeviceInfo>& device) {
  if (!device) {
    Print(fmt::format("\nNothing is measured on a GPU: {}.\n", device.error().message));
    return;
  }
  Print(fmt::format(
      "\nTable 1 on a GPU, {}: milliseconds a frame, median; a thread a ray, copies not counted\n\n"
      "| scene | brute | grid | restart | backtrack | push-down | ropes | brute / restart | grid / restart | "
      "restart / backtrack | restart, ours | backtrack, ours | push-down, ours | ropes, ours |\n"
      "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n",
      device->name));
  for (const Measured& m : all) {
    if (!*m.on_device) {
      Print(fmt::format("| {} | {} |\n", m.name, m.on_device->error().message));
      continue;
    }
    const Milliseconds ms((*m.on_device)->timings);
    Print(fmt::format("| {} |{}{}{}\n", m.name,
                      ms.Cells({"brute", "grid", "restart", "backtrack", "push-down", "ropes"}, 3),
                      ms.Ratios(),
                      ms.Cells({"restart, ours", "backtrack, ours", "push-down, ours", "ropes, ours"}, 3)));
    if (const PaperFigures* p = m.paper)
      Print(fmt::format(
          "| the paper's | {:.0f} | {:.0f} | {:.0f} | {:.0f} | - | - | {:.2f} | {:.2f} | {:.2f} | - | - | - "
          "| - |\n",
          p->brute, p->grid_ms, p->restart, p->backtrack, p->brute / p->restart, p->grid_ms / p->restart,
          p->restart / p->backtrack));
  }
}

void PrintTable2(const std::vector<Measured>& all) {
  Print(
      "\nTable 2: states of primary rays in millions. Transitions: leaves, each by the kernels Leaf and "
      "Continue; in brackets those that are not empty. Factors: Down and Up over the stack's Down, and over "
      "kd-backtrack's Down, which the paper takes for the stack's\n\n"
      "| scene | tree | way | down | up | intersect | transitions | to stack | to backtrack "
      "|\n|---|---|---|---|---|---|---|---|---|\n");
  for (const Measured& m : all) {
    if (const PaperFigures* p = m.paper; p && p->restart_down > 0) {
      Print(fmt::format("| {} | paper | restart | {} | 0 | {} | {} | - | {:.2f} |\n", p->name,
                        Theirs(p->restart_down), Theirs(p->intersect), Theirs(p->transitions),
                        p->restart_down / p->backtrack_down));
      Print(fmt::format("| | paper | backtrack | {} | {} | {} | {} | - | {:.2f} |\n",
                        Theirs(p->backtrack_down), Theirs(p->up), Theirs(p->intersect),
                        Theirs(p->transitions), (p->backtrack_down + p->up) / p->backtrack_down));
    }
    for (const TreeCounts& tree : m.trees) {
      const std::pair<const char*, const TraceCounts*> ways[] = {{"stack", &tree.stack},
                                                                 {"restart", &tree.restart},
                                                                 {"backtrack", &tree.backtrack},
                                                                 {"push-down", &tree.push_down},
                                                                 {"ropes", &tree.ropes}};
      for (const auto& [name, c] : ways)
        Print(fmt::format("| {} | {} | {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} ({:.2f}) | {:.2f} | {:.2f} |\n",
                          m.name, tree.name, name, Millions(c->steps), Millions(c->ups), Millions(c->tests),
                          Millions(c->leaves()), Millions(c->lists),
                          Ratio(c->steps + c->ups, tree.stack.steps),
                          Ratio(c->steps + c->ups, tree.backtrack.steps)));
    }
  }
}

/// `instructions`: of kernels, by their names, a call; "-" is printed for the others.
void PrintTable3(const std::vector<Measured>& all, const nlohmann::json& instructions) {
  const auto counted = [&](const std::string& kernel) {
    const auto found = instructions.find(kernel);
    return found != instructions.end() && found->is_number() ? fmt::format("{:.1f}", found->get<double>())
                                                             : "-";
  };
  for (const Measured& m : all) {
    if (m.kernels.empty()) continue;
    Print(fmt::format(
        "\nTable 3: kernels over the rays of {}, their tree; scalar, one core. Words of 32 bits, a call. "
        "Instructions: those of --instructions\n\n| kernel | instructions | words in | out | "
        "dependent "
        "fetches | ns a call | GB/s | calls timed |\n|---|---|---|---|---|---|---|---|\n",
        m.name));
    for (const KernelCost& k : m.kernels)
      Print(fmt::format("| {} | {} | {:.1f} | {:.1f} | {:.2f} | {:.1f} | {:.2f} | {} |\n", k.name,
                        counted(k.name), k.words_in, k.words_out, k.fetches, k.nanoseconds, k.gigabytes_per_s,
                        k.calls));
    Print(
        "\nThe paper's, on an ATI X800 XT PE\n\n| kernel | instructions | floats in/out | dependent fetches "
        "| GB/s "
        "|\n|---|---|---|---|---|\n"
        "| Brute Intersect | 37 | 12/4 | 0 | 20.7 |\n| Grid Traverse | 57 | 26/16 | 2 | 10.8 |\n"
        "| Grid Intersect | 83 | 36/8 | 16 | 16.6 |\n| KD Down | 66 | 15/4 | 3 | 15.7 |\n"
        "| KD Up | 36 | 20/4 | 8 | 24.5 |\n| KD Intersect | 72 | 33/8 | 13 | 18.5 |\n");
  }
}

/// Bytes that a frame reads from textures, over its time: of the fused kernels, whose streams are registers.
void PrintFrames(const std::vector<Measured>& all) {
  Print(fmt::format(
      "\nTable 3 of whole frames: megabytes that the scalar kernels read from textures, each read counted, "
      "caches or not; over table 1's times the effective bandwidth in GB/s. Lanes of the processor read a "
      "fourth word with each corner and node, which is not counted\n\n| scene | structure | MB | {}, one "
      "core | GPU |\n"
      "|---|---|---|---|---|\n",
      BestSimt().isa));
  for (const Measured& m : all) {
    const auto row = [&](const std::string& name, uint64_t words) {
      const double megabytes = static_cast<double>(words) * sizeof(uint32_t) / 1e6;
      const auto speed = [&](const std::vector<Timing>& timings) {
        const double ms = Milliseconds(timings).Of(name);
        return ms > 0 ? fmt::format("{:.2f}", megabytes / ms) : "-";
      };
      Print(fmt::format("| {} | {} | {:.1f} | {} | {} |\n", m.name, name, megabytes, speed(m.timings),
                        m.on_device && *m.on_device ? speed((*m.on_device)->timings) : "-"));
    };
    row("grid", m.grid.words);
    for (const TreeCounts& tree : m.trees) {
      const auto which = static_cast<size_t>(&tree - m.trees.data());
      row(NameOf("restart", which), tree.restart.words);
      row(NameOf("backtrack", which), tree.backtrack.words);
      row(NameOf("push-down", which), tree.push_down.words);
      row(NameOf("ropes", which), tree.ropes.words);
    }
  }
}

nlohmann::json CountsJson(const FrameCounts& c) {
  return {{"down", c.steps},  {"up", c.ups},          {"lists", c.lists}, {"empty_lists", c.empty_lists},
          {"tests", c.tests}, {"resumes", c.resumes}, {"words", c.words}};
}

nlohmann::json ToJson(const Measured& m) {
  nlohmann::json j = {{"scene", m.name},
                      {"triangles", m.triangles},
                      {"rays", m.rays},
                      {"grid_resolution", m.cells},
                      {"grid", CountsJson(m.grid)}};
  for (const Timing& t : m.timings) j["seconds"][t.name] = t.seconds;
  if (m.on_device && !*m.on_device) j["gpu_error"] = m.on_device->error().message;
  if (m.on_device && *m.on_device)
    for (const Timing& t : (*m.on_device)->timings) j["gpu_seconds"][t.name] = t.seconds;
  for (const TreeCounts& tree : m.trees)
    j["trees"][tree.name] = {{"splits", tree.splits},
                             {"leaves", tree.leaves},
                             {"build_seconds", tree.build_seconds},
                             {"depth", tree.depth},
                             {"references", tree.references},
                             {"stack", CountsJson(tree.stack)},
                             {"restart", CountsJson(tree.restart)},
                             {"backtrack", CountsJson(tree.backtrack)},
                             {"push_down", CountsJson(tree.push_down)},
                             {"ropes", CountsJson(tree.ropes)}};
  for (const KernelCost& k : m.kernels)
    j["kernels"].push_back({{"kernel", k.name},
                            {"calls", k.calls},
                            {"words_in", k.words_in},
                            {"words_out", k.words_out},
                            {"fetches", k.fetches},
                            {"ns", k.nanoseconds},
                            {"gb_per_s", k.gigabytes_per_s}});
  return j;
}

/// The stores named, or the stores of the paper's scenes in the folder, in the paper's order.
std::vector<std::string> StoresOf(const Options& options) {
  std::vector<std::string> stores = options.stores;
  if (options.folder.empty()) return stores;
  for (const PaperFigures& figures : kPaperFigures) {
    const std::string path = options.folder + "/" + figures.store + ".quarry";
    if (std::filesystem::exists(path)) stores.push_back(path);
  }
  return stores;
}

int Main(int argc, char** argv) {
  Options options;
  CLI::App app(
      "The tables of Foley & Sugerman 2005 on this machine, on one core and on a GPU where there is one, as "
      "Markdown.");
  app.footer(
      "Example:\n  tests/laboratory/tables/make_scenes stores\n  quarry bench papers --folder stores --json "
      "papers.json\n\n"
      "NAME.path.json beside a store has its camera. Table 3 is measured for the kitchen alone.\n"
      "CUDA_VISIBLE_DEVICES= (empty) leaves the GPU out.");
  app.add_option("store", options.stores, "Stores made by quarry-preprocess --no-textures");
  app.add_option(
         "--folder", options.folder,
         "The paper's scenes in this folder: frame-cornell.quarry, frame-bunny.quarry, frame-robots.quarry, "
         "frame-kitchen.quarry")
      ->check(CLI::ExistingDirectory);
  app.add_option("--size", options.size, "Pixels on a side, a multiple of 8")
      ->check(CLI::Range(8, 16384))
      ->capture_default_str();
  app.add_option("--repetitions", options.repetitions, "Medians of so many")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--instructions", options.instructions,
                 "Table 3's instructions, counted by another program: JSON, {\"KD Down\": 66, ...}")
      ->check(CLI::ExistingFile);
  app.add_flag("--no-brute-force", options.no_brute_force,
               "Without brute force, which takes minutes for a million triangles");
  app.add_option("--json", options.json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = bench::ReadArguments(app, argc, argv)) return *status;
  const auto fail = [](const std::string& message, int status) {
    Log(fmt::format("quarry bench papers: {}", message));
    return status;
  };
  if (options.size % RayPacket::kSide != 0) return fail("--size: not a multiple of 8", 2);
  const std::vector<std::string> stores = StoresOf(options);
  if (stores.empty())
    return fail(options.folder.empty() ? "name stores, or a folder with --folder"
                                       : options.folder +
                                             ": has none of the paper's scenes, as frame-bunny.quarry; "
                                             "tests/laboratory/tables/make_scenes makes them",
                2);
  nlohmann::json instructions = nlohmann::json::object();
  if (!options.instructions.empty()) {
    instructions = nlohmann::json::parse(std::ifstream(options.instructions), nullptr, false);
    if (!instructions.is_object()) return fail(options.instructions + ": is no JSON object of kernels", 2);
  }
#ifdef QUARRY_WITHOUT_CUDA
  const Result<cuda::DeviceInfo> device = Fail("the program was built without CUDA");
#else
  const Result<cuda::DeviceInfo> device = cuda::FindDevice();
#endif
  // A store that cannot be measured is refused before minutes are spent on the others.
  for (const std::string& store : stores)
    if (const Status fit = PapersScene::Check(store, options.size); !fit)
      return fail(fit.error().message, fit.error().exit_status());
  std::vector<Measured> all;
  nlohmann::json results = {
      {"size", options.size}, {"repetitions", options.repetitions}, {"isa", BestSimt().isa}};
  if (device)
    results["gpu"] = {{"name", device->name},
                      {"driver", device->driver},
                      {"runtime", device->runtime},
                      {"repetitions", kDeviceRepetitions * options.repetitions}};
  for (const std::string& store : stores) {
    Result<Measured> measured = Measure(store, options, device.has_value());
    if (!measured) return fail(measured.error().message, measured.error().exit_status());
    results["scenes"].push_back(ToJson(*measured));
    all.push_back(std::move(*measured));
  }
  Print(
      fmt::format("Primary rays of {0}x{0} pixels, medians of {1}.\n\n", options.size, options.repetitions));
  PrintScenes(all);
  PrintTable1(all);
  PrintDevice(all, device);
  PrintTable2(all);
  PrintTable3(all, instructions);
  PrintFrames(all);
  if (!bench::WriteFigures(options.json, results.dump(2))) return 1;
  for (const Measured& m : all) {
    if (!m.on_device) continue;
    if (!*m.on_device) return fail(fmt::format("{} on the GPU: {}", m.name, m.on_device->error().message), 1);
    if ((*m.on_device)->differences != 0)
      return fail(fmt::format("{}: {} on the GPU finds other hits for {} rays", m.name,
                              (*m.on_device)->different, (*m.on_device)->differences),
                  1);
  }
  return 0;
}

}  // namespace
}  // namespace quarry::laboratory

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench papers", "figures that were printed stand"}, argc, argv,
                            quarry::laboratory::Main);
}

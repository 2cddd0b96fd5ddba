// `quarry bench stream`: the machine of Purcell et al. 2002 on a model, and its tables and figures.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>

#include "common/base/log.h"
#include "common/engine/renderer.h"
#include "common/program/run_program.h"
#include "deploy/command/model_cache.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/views.h"
#include "tests/laboratory/machine/study_run.h"
#include "tests/laboratory/page/plots.h"
#include "tests/laboratory/structures/grid.h"
#include "tests/laboratory/structures/kd_tree.h"
#include "tests/laboratory/structures/kd_ways.h"
#include "tests/laboratory/structures/store_tree.h"
#include "tests/laboratory/tables/callgrind.h"
#include "tests/laboratory/tables/instructions.h"
#include "tests/laboratory/tables/stream_tables.h"

namespace quarry::laboratory {
namespace {

struct Options {
  StudyOptions study;
  std::string model, accelerator = "grid", tree = "ours", oracle = "share", json, plots;
  uint32_t cells = 64, count_size = 64;
  bool interior = false, no_instructions = false, no_check = false, quiet = false;
  std::string only;  ///< the renderer to run alone, under callgrind
};

void Say(const Options& options, const std::string& what) {
  if (!options.quiet && options.only.empty()) Log(what);
}

/// The pixels that workers render.
Result<std::vector<float>> RenderedPixels(const std::string& store, const View& view) {
  QUARRY_ASSIGN(const Scene scene, Scene::Open(store));
  QUARRY_ASSIGN(const auto renderer,
                quarry::Renderer::Create(scene, {.cache_bytes = 1ull << 30, .threads = 2}));
  std::vector<float> image(size_t{3} * view.width * view.height);
  const std::vector<Tile> tiles = TilesOf(view.crop);
  QUARRY_TRY(
      renderer->Render(view, tiles, [&](size_t i, const RenderedTile& result, quarry::Renderer::Progress) {
        const PixelRect& r = tiles[i].pixels;
        for (uint32_t p = 0; p < r.height * r.width; ++p)
          std::memcpy(&image[size_t{3} * ((r.y + p / r.width) * view.width + r.x + p % r.width)],
                      result.pixels.data() + size_t{4 * kColorWords} * p, 3 * sizeof(float));
      }));
  return image;
}

Result<std::unique_ptr<Picture>> MakePicture(const LaboratoryScene& scene, Renderer renderer,
                                             const StudyOptions& o) {
  const bool path = renderer == Renderer::kPath;
  const uint32_t size = path ? std::min(o.path_size, o.size) : o.size;
  QUARRY_ASSIGN(View view, MakeView(scene, renderer, o.camera, size, size, path ? o.path_samples : 1));
  return std::make_unique<Picture>(scene, renderer, std::move(view));
}

/// A way to make the whole study over one structure.
using RunStudy =
    std::function<Result<Study>(const Options&, const LaboratoryScene&, const std::string& store)>;

/// Instructions of this program's kernels when it runs one renderer on a small picture.
Result<Instructions> InstructionsOf(const Options& o, const std::string& store, Renderer renderer) {
  std::vector<std::string> command{std::filesystem::read_symlink("/proc/self/exe").string(),
                                   store,
                                   "--only",
                                   kRendererNames[static_cast<uint32_t>(renderer)],
                                   "--size",
                                   std::to_string(o.count_size),
                                   "--path-size",
                                   std::to_string(o.count_size),
                                   "--path-samples",
                                   "1",
                                   "--structure",
                                   o.accelerator,
                                   "--tree",
                                   o.tree,
                                   "--cells",
                                   std::to_string(o.cells)};
  if (o.interior) command.emplace_back("--interior");
  QUARRY_ASSIGN(const InstructionCount count, CountKernelInstructions(command));
  return count.instructions;
}

/// Checks and instructions of a renderer whose runs `row` has. Its pictures are dropped.
Result<RendererRow> CheckedRow(RendererRow row, const Options& o, const Picture& picture,
                               const std::string& store) {
  row.same_schedules = SamePixels(row.multipass.pixels, row.branching.pixels);
  if (row.renderer != Renderer::kPath && !o.no_check) {
    QUARRY_ASSIGN(const auto rendered, RenderedPixels(store, picture.context.view));
    row.same_as_render = SamePixels(row.branching.pixels, rendered);
  }
  row.multipass.pixels = row.branching.pixels = {};
  if (!o.no_instructions) {
    QUARRY_ASSIGN(row.instructions, InstructionsOf(o, store, row.renderer));
  }
  return row;
}

/// The runs of the ray caster by all oracles and schedules. Their pictures are compared with the branching
/// run's. Only its picture and the multipass run's are kept.
template <class A>
Study StudyRayCaster(const StudyRunner<A>& runner, const Options& o, const Picture& picture) {
  Study study;
  study.accelerator = o.accelerator;
  Say(o, "bandwidth of both schedules...");
  study.branching = runner.CountedBranching(picture);
  const auto compare = [&](const std::vector<float>& pixels) {
    study.same_runs &= SamePixels(pixels, study.branching.pixels);
  };
  study.multipass = runner.CountedMultipass(picture, {}, 0);
  study.unrolled = runner.CountedMultipass(picture, o.study.unrolling, 0);
  study.tiled = runner.CountedMultipass(picture, {}, o.study.tile);
  compare(study.multipass.pixels);
  for (CountedRun* run : {&study.unrolled, &study.tiled}) {
    compare(run->pixels);
    run->pixels = {};
  }
  for (uint32_t k = 0; k < kOracles; ++k) {
    Say(o, fmt::format("oracle {}...", kOracleNames[k]));
    const Oracle oracle{static_cast<OracleKind>(k), o.study.oracle.share};
    const auto run = runner.Multipass(picture, oracle, {}, 0);
    study.oracles.push_back({kOracleNames[k], run.counts});
    compare(run.pixels);
  }
  return study;
}

template <class A>
Result<Study> StudyWith(const A& accelerator, const Options& o, const LaboratoryScene& scene,
                        const AddressSpace& addresses, const std::string& store) {
  const StudyRunner<A> runner(accelerator, addresses, o.study);
  if (!o.only.empty()) {
    const auto name = std::ranges::find(kRendererNames, o.only, [](const char* n) { return std::string(n); });
    QUARRY_ASSIGN(const auto picture,
                  MakePicture(scene, static_cast<Renderer>(name - std::begin(kRendererNames)), o.study));
    StartCountingInstructions();
    runner.Multipass(*picture, o.study.oracle, {}, 0);
    StopCountingInstructions();
    return Study{};
  }
  Study study;
  for (uint32_t r = 0; r < kRenderers; ++r) {
    const auto renderer = static_cast<Renderer>(r);
    QUARRY_ASSIGN(const auto picture, MakePicture(scene, renderer, o.study));
    RendererRow row{renderer, {}, {}, {}};
    if (renderer == Renderer::kRaycast) {
      study = StudyRayCaster(runner, o, *picture);
      row.multipass = study.multipass;
      row.branching = study.branching;
      study.multipass.pixels = {};
    } else {
      Say(o, fmt::format("{}...", kRendererNames[r]));
      row.multipass = runner.CountedMultipass(*picture, {}, 0);
      row.branching = runner.CountedBranching(*picture);
    }
    QUARRY_ASSIGN(row, CheckedRow(std::move(row), o, *picture, store));
    study.renderers.push_back(std::move(row));
  }
  return study;
}

Result<Study> MakeStudy(const Options& o, LaboratoryScene& scene, const std::string& store) {
  AddressSpace addresses = scene.addresses();
  Say(o, fmt::format("{} triangles; building the {}...", scene.triangles().size(), o.accelerator));
  if (o.accelerator == "grid") {
    const UniformGrid grid(scene.triangles(), scene.padding(), scene.box(),
                           CubicalResolution(scene.box(), o.cells), addresses);
    const GridResolution& n = grid.resolution();
    Say(o, fmt::format("{} x {} x {} cells", n[0], n[1], n[2]));
    return StudyWith(grid, o, scene, addresses, store);
  }
  QUARRY_ASSIGN(const KdTree plain, o.tree == "theirs"
                                        ? BuildFoleyTree(scene.triangles(), scene.padding(), scene.box())
                                        : ReadStoreTree(scene));
  const TextureTree tree(plain, scene.box(), addresses);
  if (o.accelerator == "restart") return StudyWith(KdRestart(tree), o, scene, addresses, store);
  if (o.accelerator == "ropes")
    return StudyWith(KdRopes(plain, scene.box(), addresses), o, scene, addresses, store);
  if (o.accelerator == "push-down") return StudyWith(KdPushDown(tree), o, scene, addresses, store);
  return StudyWith(KdBacktrack(tree), o, scene, addresses, store);
}

/// Memory of the largest run for each pixel: Whitted's renderer has lists, the shadow caster rasterises.
template <class... A>
constexpr uint64_t RunBytes() {
  constexpr uint64_t kPictures = 4;  // of both schedules, of one more run, of the workers
  return kPictures * 3 * sizeof(float) +
         std::max({std::max(Machine<A, CountingMemory>::BytesPerPixel({}, false),
                            Machine<A, CountingMemory>::BytesPerPixel({true, true, false}, true))...});
}

/// `box`: of the scene.
MemoryNeeds NeedsOf(const Options& o, const Box& box) {
  const bool others = o.only.empty() && !(o.no_instructions && o.no_check);
  uint64_t cells = 0;
  if (o.accelerator == "grid") {
    const GridResolution n = CubicalResolution(box, o.cells);
    cells = uint64_t{n[0]} * n[1] * n[2];
  }
  return {.structure_bytes = o.accelerator == "grid" ? kGridBytes : kTreeBytes,
          .cells = cells,
          .pixels = uint64_t{o.study.size} * o.study.size,
          .bytes_per_pixel = RunBytes<UniformGrid, KdRestart, KdPushDown, KdBacktrack, KdRopes>(),
          .twice = others};
}

Result<int> Run(Options& o) {
  if (!o.plots.empty() && !GnuplotInstalled()) return Fail("gnuplot is not installed: it draws --plots");
  QUARRY_ASSIGN(const std::string store, StoreFor(o.model, {}, true));
  QUARRY_ASSIGN(const StoreReader opened, StoreReader::Open(store));
  if (const std::string why = WhyNotCounted(); o.only.empty() && !o.no_instructions && !why.empty())
    return Fail(why + "; valgrind counts instructions: without it, give --no-instructions");
  const SceneMeta& meta = opened.catalog().meta;
  QUARRY_ASSIGN(const auto scene,
                LaboratoryScene::Load(store, NeedsOf(o, {meta.root_lower, meta.root_upper})));
  QUARRY_ASSIGN(o.study.camera, bench::FindView(store, scene->catalog().meta, o.interior));
  o.study.oracle.kind = static_cast<OracleKind>(
      std::ranges::find(kOracleNames, o.oracle, [](const char* n) { return std::string(n); }) -
      std::begin(kOracleNames));
  QUARRY_ASSIGN(const Study study, MakeStudy(o, *scene, store));
  if (!o.only.empty()) return 0;
  const std::string name = std::filesystem::path(o.model).stem().string();
  Print(fmt::format("# {}: {} triangles, {}, {} x {} pixels, oracle {}\n\n", name, scene->triangles().size(),
                    o.accelerator, o.study.size, o.study.size, o.oracle));
  // The paper's bunny, or the same on a floor of two triangles.
  const size_t triangles = scene->triangles().size();
  PrintStudy(study, o.study, triangles == 69451 || triangles == 69453);
  if (!bench::WriteFigures(o.json, StudyToJson(study).dump(2))) return 1;
  if (!o.plots.empty()) QUARRY_TRY(DrawStudy(study, o.plots, name));
  if (!study.same_runs) {
    Log(fmt::format("{}: pictures of oracles, unrolled, tiled and branching runs differ", o.model));
    return 1;
  }
  for (const RendererRow& row : study.renderers)
    if (!row.same_schedules || (row.same_as_render && !*row.same_as_render)) {
      Log(fmt::format("{}: pictures differ, see table 3", o.model));
      return 1;
    }
  return 0;
}

int Main(int argc, char** argv) {
  Options o;
  CLI::App app(
      "Renders a model by the streaming ray tracer of Purcell et al. 2002: kernels over streams of rays, "
      "multipass "
      "and branching. Prints the paper's tables and figures for it.",
      "quarry bench stream");
  const auto names = [](const auto& list) {
    return CLI::IsMember(std::vector<std::string>(std::begin(list), std::end(list)));
  };
  app.add_option("model", o.model, "Store, or model without textures")->required();
  app.add_option("--structure", o.accelerator, "What rays go through")
      ->check(CLI::IsMember({"grid", "restart", "push-down", "backtrack", "ropes"}))
      ->capture_default_str();
  app.add_option("--tree", o.tree, "kd-trees: the store's, or as Foley & Sugerman's")
      ->check(CLI::IsMember({"ours", "theirs"}))
      ->capture_default_str();
  app.add_option("--cells", o.cells, "Cells of the grid along the shortest side")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  app.add_option("--oracle", o.oracle, "Chooses the next pass")
      ->check(names(kOracleNames))
      ->capture_default_str();
  app.add_option("--share", o.study.oracle.share,
                 "Of the oracle 'share': intersect from this share of rays on")
      ->check(CLI::Range(0.001, 1.0))
      ->capture_default_str();
  app.add_option("--size", o.study.size, "Pixels a side")->check(CLI::Range(8, 4096))->capture_default_str();
  app.add_option("--path-size", o.study.path_size, "Pixels a side of the path tracer's picture")
      ->check(CLI::Range(8, 4096))
      ->capture_default_str();
  app.add_option("--path-samples", o.study.path_samples, "Its samples a pixel")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  app.add_option("--unroll-traverse", o.study.unrolling.traverse, "Steps a pass of the unrolled run")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--unroll-intersect", o.study.unrolling.intersect, "Its tests a pass")
      ->check(CLI::Range(1, 64))
      ->capture_default_str();
  app.add_option("--tile", o.study.tile, "Pixels a side of tiles of the tiled run")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  app.add_option("--cache", o.study.cache.bytes, "Bytes of the texture cache")->capture_default_str();
  app.add_option("--line", o.study.cache.line, "Bytes of its lines")->capture_default_str();
  app.add_option("--ways", o.study.cache.ways, "Lines a set; 1: direct mapped")->capture_default_str();
  app.add_option("--count-size", o.count_size, "Pixels a side of the picture whose instructions are counted")
      ->check(CLI::Range(8, 1024))
      ->capture_default_str();
  app.add_flag("--no-instructions", o.no_instructions, "Do not count instructions (valgrind)");
  app.add_flag("--no-check", o.no_check, "Do not compare with Quarry's own pictures");
  app.add_flag("--interior", o.interior, "Look from inside a scene without a camera path");
  app.add_option("--plots", o.plots, "Draw figures 6 to 9 into this folder (gnuplot)")
      ->check(CLI::ExistingDirectory);
  app.add_option("--json", o.json, "Write all figures to this file")->check(bench::CheckFigures);
  app.add_flag("--quiet", o.quiet, "No progress");
  app.add_option("--only", o.only, "Runs one renderer, for the count of instructions")
      ->check(names(kRendererNames))
      ->group("");
  app.footer("Example:\n  quarry bench stream bunny.quarry --size 1024 --plots figures");
  if (const auto status = bench::ReadArguments(app, argc, argv)) return *status;
  if (const auto cache = TextureCache::Create(o.study.cache); !cache) {
    Log(fmt::format("quarry bench stream: {}", cache.error().message));
    return 2;
  }
  std::signal(SIGPIPE, SIG_IGN);  // of a gnuplot that ends early
  const auto status = Run(o);
  if (status) return *status;
  if (!status.error().message.empty()) Log(fmt::format("quarry bench stream: {}", status.error().message));
  return 1;
}

}  // namespace
}  // namespace quarry::laboratory

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench stream", "figures that were printed stand"}, argc, argv,
                            quarry::laboratory::Main);
}

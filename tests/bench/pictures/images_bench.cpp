// `quarry bench images`: whole pictures on two threads against a renderer around Embree with the same
// shading.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>

#include "common/base/log.h"
#include "common/engine/integrators/path/light_range.h"
#include "common/engine/integrators/path/path_tracer.h"
#include "common/engine/renderer.h"
#include "common/program/run_program.h"
#include "common/scene/framing.h"
#include "common/voxel/store_reader.h"
#include "deploy/command/cluster.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/pictures/embree_image.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/views.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

constexpr unsigned kThreads = 2;

struct Options {
  std::vector<std::string> stores;
  std::string mode;
  int repetitions = 3;
  uint32_t size = 1024, spp = 1;
  bool interior = false;
  std::string json;
};

/// The picture's rows of RGB. Blocks are decoded on the way, and stay in the renderer's cache.
Result<std::vector<float>> RenderImage(Renderer& renderer, const View& view) {
  std::vector<float> image(size_t{3} * view.width * view.height);
  const std::vector<Tile> tiles = TilesOf(view.crop);
  QUARRY_TRY(renderer.Render(view, tiles, [&](size_t i, const RenderedTile& result, Renderer::Progress) {
    const PixelRect& r = tiles[i].pixels;
    for (uint32_t p = 0; p < r.height * r.width; ++p)
      std::memcpy(&image[size_t{3} * ((r.y + p / r.width) * view.width + r.x + p % r.width)],
                  result.pixels.data() + size_t{4 * kColorWords} * p, 3 * sizeof(float));
  }));
  return image;
}

Result<std::vector<std::unique_ptr<ResidentBlock>>> DecodeAll(const StoreReader& store) {
  const Catalog& catalog = store.catalog();
  std::vector<std::unique_ptr<ResidentBlock>> blocks(catalog.block_numbers());
  BlockDecoder decoder;
  for (uint32_t number = 0; number < blocks.size(); ++number) {
    const std::optional<BlockKey> key = catalog.BlockOf(number);
    if (!key) continue;
    QUARRY_ASSIGN(const Bytes stored, store.ReadBlock(*key));
    blocks[number] = std::make_unique<ResidentBlock>();
    blocks[number]->bytes = *PageBuffer::TryGet(catalog.block(*key).decoded);
    QUARRY_TRY(DecodeBlock(catalog, *key, stored, decoder, *blocks[number]));
  }
  return blocks;
}

/// The command as a person types it: processes started, blocks fetched and decoded, a picture written.
Result<double> TimeCommand(const std::string& store, const std::string& mode, const View& view) {
  const CameraSpec& c = view.camera;
  const auto vector = [](const glm::dvec3& v) {
    return fmt::format("{:.17g},{:.17g},{:.17g}", v.x, v.y, v.z);
  };
  const std::string picture =
      (std::filesystem::temp_directory_path() / fmt::format("quarry-bench-{}.png", getpid())).string();
  const auto start = Clock::now();
  const auto rc = RunSibling("quarry", {"render",
                                        store,
                                        "-o",
                                        picture,
                                        "--quiet",
                                        "--cache",
                                        "8G",
                                        "--threads",
                                        std::to_string(kThreads),
                                        "--mode",
                                        mode,
                                        "--spp",
                                        std::to_string(view.spp),
                                        "--size",
                                        fmt::format("{}x{}", view.width, view.height),
                                        "--eye",
                                        vector(c.eye),
                                        "--at",
                                        vector(c.at),
                                        "--up",
                                        vector(c.up),
                                        "--fov",
                                        fmt::format("{:.17g}", c.fov_degrees)});
  const double seconds = SecondsSince(start);
  std::filesystem::remove(picture);
  if (!rc) return tl::unexpected<Error>(rc.error());
  if (*rc != 0) return Fail(fmt::format("{}: quarry render failed", store));
  return seconds;
}

struct Difference {
  size_t pixels = 0;  ///< that differ by more than half a step of 8 bits
  double mean = 0;    ///< of |difference|, over all values
};
Difference Compare(const std::vector<float>& a, const std::vector<float>& b) {
  Difference d;
  for (size_t i = 0; i < a.size(); i += 3) {
    bool differs = false;
    for (size_t c = i; c < i + 3; ++c) {
      const float difference = std::fabs(a[c] - b[c]);
      differs |= difference > 0.5f / 255;
      d.mean += difference / static_cast<double>(a.size());
    }
    d.pixels += differs;
  }
  return d;
}

/// Renders a picture once more, with its blocks in the cache. Returns the seconds; `rays`: traced in all.
Result<double> TimePicture(Renderer& renderer, const View& view, std::shared_ptr<const Integrator> integrator,
                           uint64_t& rays) {
  const auto from = Clock::now();
  rays = 0;
  QUARRY_TRY(renderer.Render(
      view, TilesOf(view.crop),
      [&](size_t, const RenderedTile& result, Renderer::Progress) { rays += result.rays; }, {},
      std::move(integrator)));
  return SecondsSince(from);
}

/// Mode path: the rate of its rays, and how many of them look for light. `quarry bench kernels` has the rates
/// of such rays alone, which bound it.
Status RunPath(const std::string& path, const Options& options, nlohmann::json& results) {
  QUARRY_ASSIGN(const Scene scene, Scene::Open(path));
  const Catalog& catalog = scene.catalog();
  QUARRY_ASSIGN(const auto renderer, Renderer::Create(scene, {uint64_t{1} << 40, kThreads}));
  View view;
  view.mode = RenderMode::kPath;
  view.width = view.height = options.size;
  view.spp = options.spp;
  view.lights = {DefaultSun(catalog.meta.up_axis)};
  view.sky.turbidity = 3;
  QUARRY_ASSIGN(view.camera, FindView(path, catalog.meta, options.interior));
  QUARRY_TRY(NormalizeView(view));
  FitLight(view, catalog);
  // Paths are the same whether vertices ask for light or not; without asking there are no light rays.
  const auto silent = std::make_shared<PathTracer>(view, catalog, LightWays::kMet);
  uint64_t rays = 0, path_rays = 0;
  std::vector<double> seconds;
  QUARRY_TRY(TimePicture(*renderer, view, silent, path_rays).map([](double) {}));  // loads its blocks
  for (int r = 0; r <= options.repetitions; ++r) {
    QUARRY_ASSIGN(const double s, TimePicture(*renderer, view, {}, rays));
    if (r > 0) seconds.push_back(s);
  }
  const double s = Median(seconds), light_rays = static_cast<double>(rays - path_rays);
  const double rate = static_cast<double>(rays) / s / kThreads;
  const std::string name = std::filesystem::path(path).stem().string();
  Print(fmt::format(
      "{}: path {:.3f} s; {:.2f} million rays a second and thread; {:.2f} path rays and {:.2f} light "
      "rays a sample\n",
      name, s, rate * 1e-6,
      static_cast<double>(path_rays) / (static_cast<double>(view.width) * view.height * view.spp),
      light_rays / (static_cast<double>(view.width) * view.height * view.spp)));
  results.push_back({{"scene", name},
                     {"mode", "path"},
                     {"engine_s", s},
                     {"path_rays", path_rays},
                     {"light_rays", light_rays},
                     {"rays_per_s_and_thread", rate}});
  return {};
}

Status RunScene(const std::string& path, const Options& options, nlohmann::json& results) {
  QUARRY_ASSIGN(const Scene scene, Scene::Open(path));
  const Catalog& catalog = scene.catalog();
  QUARRY_ASSIGN(const auto blocks, DecodeAll(scene.store()));
  std::vector<VoxelGeometry> voxels;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v)
    voxels.push_back(blocks[catalog.NumberOf(BlockKey::Hot(v))]->hot);
  const auto start = Clock::now();
  const EmbreeScene embree(voxels, catalog.meta.input_triangles, true);
  const double build_s = SecondsSince(start);
  QUARRY_ASSIGN(const auto renderer, Renderer::Create(scene, {uint64_t{1} << 40, kThreads}));
  const EmbreeImage reference(embree, catalog, blocks);
  const std::string name = std::filesystem::path(path).stem().string();
  Print(fmt::format("{}: {} triangles; Embree's tree (robust, best quality) takes {:.1f} s\n", name,
                    catalog.meta.input_triangles, build_s));
  View view;
  view.width = view.height = options.size;
  view.spp = options.spp;
  view.backdrop = false;
  view.lights = {DefaultSun(catalog.meta.up_axis)};
  QUARRY_ASSIGN(view.camera, FindView(path, catalog.meta, options.interior));
  QUARRY_TRY(NormalizeView(view));
  for (const auto& [mode_name, mode] : {std::pair{"raycast", RenderMode::kRaycast},
                                        {"shadow", RenderMode::kShadow},
                                        {"whitted", RenderMode::kWhitted}}) {
    view.mode = mode;
    std::vector<double> engine_s, embree_s, command_s;
    std::vector<float> theirs;
    QUARRY_ASSIGN(std::vector<float> ours, RenderImage(*renderer, view));  // loads its blocks
    for (int r = 0; r < options.repetitions; ++r) {
      auto from = Clock::now();
      QUARRY_ASSIGN(ours, RenderImage(*renderer, view));
      engine_s.push_back(SecondsSince(from));
      from = Clock::now();
      theirs = reference.Render(view, kThreads);
      embree_s.push_back(SecondsSince(from));
      QUARRY_ASSIGN(const double command, TimeCommand(path, mode_name, view));
      command_s.push_back(command);
    }
    const double a = Median(engine_s), b = Median(embree_s), c = Median(command_s);
    const Difference d = Compare(ours, theirs);
    Print(fmt::format(
        "  {:8} engine {:.3f} s, quarry render {:.3f} s, Embree {:.3f} s; Embree's time over the engine's "
        "{:.2f}, "
        "over the command's {:.2f}; {} of {} pixels differ, mean difference {:.1e}\n",
        mode_name, a, c, b, b / a, b / c, d.pixels, size_t{view.width} * view.height, d.mean));
    std::fflush(stdout);
    results.push_back({{"scene", name},
                       {"triangles", catalog.meta.input_triangles},
                       {"mode", mode_name},
                       {"engine_s", a},
                       {"command_s", c},
                       {"embree_s", b},
                       {"embree_build_s", build_s},
                       {"pixels_differ", d.pixels},
                       {"mean_difference", d.mean}});
  }
  return {};
}

int Main(int argc, char** argv) {
  Options options;
  CLI::App app("Pictures on two threads: the engine, `quarry render`, and a renderer around Embree.");
  app.add_option("store", options.stores, "Stores made by quarry-preprocess")->required();
  app.add_option("--mode", options.mode, "path: the rate of its rays instead")
      ->check(CLI::IsMember({"path"}));
  app.add_option("--repetitions", options.repetitions, "Medians of so many")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--size", options.size, "Pixels on a side")
      ->check(CLI::Range(8, 16384))
      ->capture_default_str();
  app.add_option("--spp", options.spp, "Samples per pixel")
      ->check(CLI::Range(1, 4096))
      ->capture_default_str();
  app.add_flag("--interior", options.interior, "The eye is inside the scene's box");
  app.add_option("--json", options.json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  nlohmann::json results = nlohmann::json::array();
  for (const std::string& store : options.stores) {
    const auto run = options.mode == "path" ? RunPath : RunScene;
    if (const Status status = run(store, options, results); !status) {
      Log(fmt::format("quarry-bench-images: {}", status.error().message));
      return 1;
    }
    (void)bench::WriteFigures(options.json, results.dump(2));
  }
  return 0;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench images", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}

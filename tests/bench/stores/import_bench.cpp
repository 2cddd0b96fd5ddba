// `quarry bench import`: speed of the importers, to a sink that keeps nothing. Prints the median and the
// spread of kRuns readings of each file, in MB (10^6 bytes) of file per second.

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

#include "common/base/log.h"
#include "common/program/run_program.h"
#include "preprocess/import/importer.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace {

using namespace quarry;

constexpr int kRuns = 5;

struct NullSink : ModelSink {
  uint64_t triangles = 0;

  Status BeginFile(std::string_view) override { return {}; }
  Status EndFile() override { return {}; }
  uint32_t AddMaterial(const Material&) override { return 0; }
  uint32_t AddPart(std::string_view, uint32_t) override { return 0; }
  uint32_t AddSibling(std::string_view, uint32_t) override { return 0; }
  bool takes_textures() const override { return false; }
  Result<uint32_t> AddTexture(TextureImage) override { return kNoIndex; }
  Status AddPosition(const glm::dvec3&, const Rgba8&) override { return {}; }
  Status AddNormal(const glm::vec3&) override { return {}; }
  Status AddUv(const glm::vec2&) override { return {}; }
  Status AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) override {
    triangles += corners.size() - 2;
    return {};
  }
  void Warn(std::string) override {}
};

Status Measure(const std::string& path) {
  std::vector<double> speeds;
  uint64_t triangles = 0;
  for (int run = 0; run < kRuns; ++run) {
    NullSink sink;
    const auto start = std::chrono::steady_clock::now();
    QUARRY_TRY(ImportModel(path, sink));
    const std::chrono::duration<double> wall = std::chrono::steady_clock::now() - start;
    speeds.push_back(static_cast<double>(std::filesystem::file_size(path)) / 1e6 / wall.count());
    triangles = sink.triangles;
  }
  std::ranges::sort(speeds);
  Print(fmt::format("{}: {} triangles, {:.0f} MB/s (median of {}, {:.0f} to {:.0f})\n", path, triangles,
                    speeds[kRuns / 2], kRuns, speeds.front(), speeds.back()));
  return {};
}

int Main(int argc, char** argv) {
  std::vector<std::string> files;
  CLI::App app("Speed of the importers, to a sink that keeps nothing: the median of readings of each file.");
  app.footer("Example:\n  quarry bench import dragon.ply");
  app.add_option("model", files, "Model files")->required();
  if (const auto status = bench::ReadArguments(app, argc, argv)) return *status;
  for (const std::string& file : files)
    if (const Status status = Measure(file); !status) {
      Log(status.error().message);
      return status.error().exit_status();
    }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench import", "figures that were printed stand"}, argc, argv, Main);
}

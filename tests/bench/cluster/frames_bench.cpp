// `quarry bench frames`: how long the display takes to encode a frame for a viewer.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <vector>

#include "common/base/log.h"
#include "common/math/shared_exponent.h"
#include "common/program/run_program.h"
#include "master/display/frame_encoder.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"

namespace quarry {
namespace {

/// Something like a plant: edges, gradients and a background.
uint32_t CodeAt(uint32_t x, uint32_t y) {
  const auto wave = [](double v) { return static_cast<float>(0.5 + 0.5 * std::sin(v)); };
  if (y < 100 + x / 8) return PackShared({0.55f, 0.65f, 0.8f});
  const float edge = (x / 16 + y / 24) % 3 == 0 ? 0.3f : 1.0f;
  return PackShared({edge * wave(0.02 * x), edge * wave(0.03 * y), edge * wave(0.01 * (x + y))});
}

DueFrame FrameOf(uint32_t width, uint32_t height, uint32_t step) {
  DueFrame frame;
  frame.wanted.view.width = width;
  frame.wanted.view.height = height;
  frame.wanted.view.crop = {0, 0, width, height};
  frame.in_motion = true;
  if (step == 0) {
    for (uint32_t y = 0; y < height; ++y)
      for (uint32_t x = 0; x < width; ++x) {
        const glm::vec3 color = UnpackShared(CodeAt(x, y));
        for (int c = 0; c < 3; ++c) frame.exact.push_back(std::bit_cast<uint32_t>(color[c]));
      }
    return frame;
  }
  frame.step = frame.scale = step;
  PictureRows rows{0, width, {}};
  for (uint32_t y = 0; y < height; ++y)
    for (uint32_t x = 0; x < width; ++x)
      // A lattice's points lie in the corners of their squares.
      rows.codes.push_back(x % step == 0 && y % step == 0 ? CodeAt(x, y) : kUntraced);
  frame.rows.push_back(std::move(rows));
  return frame;
}

int Main(int argc, char** argv) {
  uint32_t width = 640, height = 480;
  CLI::App app(
      "How long the display takes to encode a frame for a viewer: a picture of which every pixel is traced, "
      "lattices of each second to each 16th a side, and an exact one. Medians of 50, on one thread.");
  app.footer("Example:\n  quarry bench frames 1920 1080");
  app.add_option("width", width, "Pixels")->check(CLI::Range(1, 16384))->capture_default_str();
  app.add_option("height", height, "Pixels")->check(CLI::Range(1, 16384))->capture_default_str();
  if (const auto status = bench::ReadArguments(app, argc, argv)) return *status;
  FrameEncoder encoder;
  std::optional<ToneTable> tone;
  for (const uint32_t step : {1u, 2u, 4u, 8u, 16u, 0u}) {
    const DueFrame frame = FrameOf(width, height, step);
    std::vector<double> times;
    size_t bytes = 0;
    for (int i = 0; i < 50; ++i) {
      const auto encoded = encoder.Encode(frame, {}, 80, tone);
      if (!encoded) return Log(encoded.error().message), 1;
      times.push_back(encoded->encode_s * 1e3);
      bytes = encoded->stripes[0].image.size();
    }
    std::ranges::nth_element(times, times.begin() + 25);
    Print(fmt::format("{}x{} {}: {:.2f} ms, {:.1f} KB\n", width, height,
                      step == 0 ? "exact" : fmt::format("step {}", step), times[25],
                      static_cast<double>(bytes) / 1e3));
  }
  return 0;
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench frames", "figures that were printed stand"}, argc, argv,
                            quarry::Main);
}

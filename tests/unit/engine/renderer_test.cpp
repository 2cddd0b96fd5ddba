#include "common/engine/renderer.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <new>
#include <stop_token>
#include <thread>

#include "common/engine/integrators/integrator.h"
#include "common/engine/rays/lanes.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"
#include "tests/support/stores/small_store.h"

namespace quarry {
namespace {

using test::Looking;
using test::Row;
using Blocks = std::vector<BlockKey>;

constexpr PixelRect kMiddle{160, 128, 32, 32};

View Seen(const glm::dvec3& eye, const glm::dvec3& at) { return (Looking(eye, at)); }

std::unique_ptr<Renderer> MakeRenderer(const Row& row, uint64_t cache_bytes = 1 << 20, unsigned threads = 1) {
  auto made = Renderer::Create(*row.scene, {cache_bytes, threads});
  REQUIRE(made.has_value());
  return std::move(*made);
}

/// One tile of a view. Fails the test when it cannot be rendered.
RenderedTile RenderOne(Renderer& renderer, const View& view, const Tile& tile) {
  RenderedTile out;
  const Status status =
      renderer.Render(view, std::span(&tile, 1),
                      [&](size_t, RenderedTile result, Renderer::Progress) { out = std::move(result); });
  REQUIRE(status.has_value());
  return out;
}

Blocks BlocksSeen(const View& view) {
  const Row row;
  return RenderOne(*MakeRenderer(row), view, {kMiddle, 2}).blocks;
}

}  // namespace

TEST_CASE("A tile names the voxels in front of its hits, and the attributes of the hits", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row);
  const RenderedTile tile = RenderOne(*renderer, Seen({0, -20, 0}, {0, 10, 0}), {kMiddle, 2});
  CHECK(tile.blocks == Blocks{BlockKey::Hot(0), BlockKey::Hot(1), BlockKey::Hot(2), BlockKey::Shading(2)});
  REQUIRE(tile.depths.size() == 16);
  for (const float depth : tile.depths) CHECK(depth == Approx(35).epsilon(0.02));
  // The other way there is nothing.
  const RenderedTile empty = RenderOne(*renderer, Seen({0, -20, 0}, {0, -30, 0}), {kMiddle, 2});
  CHECK(empty.blocks.empty());
  for (const float depth : empty.depths) CHECK(std::isinf(depth));
  // From behind the wall: its other side, and the voxel that nobody came to from the front.
  CHECK(BlocksSeen(Seen({0, 40, 0}, {0, 10, 0})) ==
        Blocks{BlockKey::Hot(2), BlockKey::Shading(2), BlockKey::Hot(3)});
}

TEST_CASE("Rays that a mode sends on visit more voxels", "[renderer]") {
  const Blocks wall{BlockKey::Hot(2), BlockKey::Shading(2)};
  const Blocks all{BlockKey::Hot(0), BlockKey::Hot(1), BlockKey::Hot(2), BlockKey::Shading(2)};
  // Close before the wall, past the voxels that lie before it.
  View view = Seen({0, 12, 0}, {0, 20, 0});
  CHECK(BlocksSeen(view) == wall);
  view.mode = RenderMode::kShadow;
  view.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  CHECK(BlocksSeen(view) == all);
  view.lights = {{LightKind::kPoint, {0, 5, 0}, glm::vec3(1)}};  // no farther than that
  CHECK(BlocksSeen(view) == Blocks{BlockKey::Hot(1), BlockKey::Hot(2), BlockKey::Shading(2)});
  view.lights = {{LightKind::kSun, {0, 1, 0}, glm::vec3(1)}};  // on the other side
  CHECK(BlocksSeen(view) == wall);
  view.mode = RenderMode::kWhitted;
  CHECK(BlocksSeen(view) == all);
}

TEST_CASE("A cache of one block and any number of threads render the same picture", "[renderer]") {
  const Row row;
  View view = Seen({0, -20, 0}, {3, 10, 4});
  view.mode = RenderMode::kWhitted;
  view.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  const std::vector<Tile> tiles = TilesOf(view.crop);
  const auto render = [&](uint64_t cache_bytes, unsigned threads) {
    std::vector<RenderedTile> out(tiles.size());
    const auto renderer = MakeRenderer(row, cache_bytes, threads);
    uint32_t last = 0, all = 0;
    REQUIRE(renderer
                ->Render(view, tiles,
                         [&](size_t i, RenderedTile result, Renderer::Progress progress) {
                           out[i] = std::move(result);
                           last = progress.done;
                           all = progress.all;  // Catch is for one thread only
                         })
                .has_value());
    CHECK(last == tiles.size());
    CHECK(all == tiles.size());
    CHECK(renderer->counters().cache.bytes <= cache_bytes);
    return out;
  };
  const auto whole = render(1 << 20, 1), small = render(row.largest(), 2);
  for (size_t i = 0; i < tiles.size(); ++i) {
    CHECK(whole[i].pixels == small[i].pixels);
    CHECK(whole[i].blocks == small[i].blocks);
    CHECK(whole[i].depths == small[i].depths);
  }
}

TEST_CASE("A picture of few samples has the first samples of a picture of many", "[renderer][path]") {
  const Row row;
  const auto renderer = MakeRenderer(row);
  for (const RenderMode mode : {RenderMode::kPath, RenderMode::kAo}) {
    View few = Seen({0, -20, 0}, {0, 10, 0}), many = few;
    few.mode = many.mode = mode;
    few.sky.radiance = many.sky.radiance = glm::vec3(0.7f);
    few.spp = 3;
    many.spp = 50;
    Tile tile{kMiddle, 1};
    tile.form = PixelForm::kSums;
    tile.samples = 3;
    const Bytes first = RenderOne(*renderer, many, tile).pixels;
    CHECK(first == RenderOne(*renderer, few, tile).pixels);
    tile.samples = 4;
    CHECK(first != RenderOne(*renderer, many, tile).pixels);
  }
}

TEST_CASE("A call can be cancelled from its own callback", "[renderer]") {
  const Row row;
  const View view = Seen({0, -20, 0}, {3, 10, 4});
  const auto renderer = MakeRenderer(row, 1 << 20, 2);
  std::stop_source stop;
  uint32_t calls = 0;
  const Status status = renderer->Render(
      view, TilesOf(view.crop),
      [&](size_t, const RenderedTile&, Renderer::Progress) {
        ++calls;
        stop.request_stop();
      },
      stop.get_token());
  REQUIRE_FALSE(status.has_value());
  CHECK(status.error().kind == ErrorKind::kCancelled);
  CHECK(calls == 1);
}

TEST_CASE("A lattice renders the pixels in the middle of its squares", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row);
  const View view = Seen({5, -20, 3}, {3, 10, 4});
  const RenderedTile all = RenderOne(*renderer, view, {kMiddle}),
                     some = RenderOne(*renderer, view, {kMiddle, 4});
  REQUIRE(some.pixels.size() == 8 * 8 * 16);
  for (size_t y = 0; y < 8; ++y)
    for (size_t x = 0; x < 8; ++x)
      CHECK(std::memcmp(&some.pixels[16 * (8 * y + x)], &all.pixels[16 * (32 * (4 * y + 2) + 4 * x + 2)],
                        12) == 0);
}

TEST_CASE("A custom integrator is given to the renderer from outside", "[renderer]") {
  /// Its radiance is the distance of the visible surface.
  class Distances final : public Integrator {
   public:
    Needs needs() const override { return {}; }
    void Shade(PacketWork& work, uint64_t lanes) const override {
      ForEachLane(lanes, [&](uint32_t i) {
        work.scratch.radiance.Set(static_cast<int>(i),
                                  glm::vec3(work.samples.t_offset[i] + work.rays.hit_t[i]));
      });
      AddLight(work, lanes, work.scratch.radiance);
      work.samples.Move(lanes, SamplePacket::kShade, SamplePacket::kNext);
    }
  };
  const Row row;
  View view = Seen({0, -20, 0}, {0, 10, 0});
  view.mode = RenderMode::kWhitted;  // of which nothing is to be seen
  const Tile tile{kMiddle};
  Bytes pixels;
  REQUIRE(MakeRenderer(row)
              ->Render(
                  view, std::span(&tile, 1),
                  [&](size_t, RenderedTile result, Renderer::Progress) { pixels = std::move(result.pixels); },
                  {}, std::make_shared<const Distances>())
              .has_value());
  REQUIRE(pixels.size() == size_t{32} * 32 * 4 * kColorWords);
  for (size_t i = 0; i < 32 * 32; ++i) {
    float pixel[kColorWords];
    std::memcpy(pixel, &pixels[i * sizeof pixel], sizeof pixel);
    CHECK(pixel[0] == Approx(35).epsilon(0.02));
    CHECK(pixel[0] == pixel[2]);
    CHECK(pixel[3] == 1);
  }
}

TEST_CASE("A store that is damaged during a render ends every call with its sentence", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row);
  const std::string path = row.scene->store().path();
  auto bytes = test::ReadFile(path);
  for (size_t i = 200; i < bytes.size(); ++i) bytes[i] = static_cast<char>(~bytes[i]);
  test::WriteFile(path, bytes);
  const View view = Seen({0, -20, 0}, {0, 10, 0});
  for (int call = 0; call < 2; ++call) {
    const Status status =
        renderer->Render(view, TilesOf(view.crop), [](size_t, const RenderedTile&, Renderer::Progress) {});
    REQUIRE_FALSE(status.has_value());
    CHECK(status.error().message.find(path) != std::string::npos);
  }
}

TEST_CASE("A compute thread without memory ends every call with a sentence, not the program", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row, 1 << 20, 2);
  const View view = Seen({0, -20, 0}, {3, 10, 4});
  const std::vector<Tile> tiles = TilesOf(view.crop);
  const Status failed =
      renderer->Render(view, tiles, [](size_t, RenderedTile, Renderer::Progress) { throw std::bad_alloc(); });
  REQUIRE_FALSE(failed.has_value());
  CHECK_THAT(failed.error().message, Catch::Contains("no memory is left"));
  CHECK_FALSE(renderer->Render(view, tiles, [](size_t, RenderedTile, Renderer::Progress) {}).has_value());
}

TEST_CASE("A voxel that names a material that the scene lacks is refused", "[renderer]") {
  const Row row(1);
  CHECK_THAT(row.scene->store().Verify([](size_t, size_t) {}).error().message,
             Catch::Contains("it names a material that the scene lacks"));
  const View view = Seen({0, -20, 0}, {0, 10, 0});
  const Status status = MakeRenderer(row)->Render(view, TilesOf(view.crop),
                                                  [](size_t, const RenderedTile&, Renderer::Progress) {});
  REQUIRE_FALSE(status.has_value());
  CHECK_THAT(status.error().message, Catch::Contains("block 4"));
}

TEST_CASE("A cache that is too small is refused with a sentence", "[renderer]") {
  const Row row;
  const auto made = Renderer::Create(*row.scene, {row.largest() - 1, 1});
  REQUIRE_FALSE(made.has_value());
  CHECK(made.error().kind == ErrorKind::kUsage);
  CHECK_THAT(made.error().message, Catch::Contains("largest block"));
}

TEST_CASE("A call that is stopped ends, and the renderer goes on", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row);
  View view = Seen({0, -20, 0}, {0, 10, 0});
  View large = view;
  large.width = large.height = large.crop.width = large.crop.height = 16384;
  large.spp = 64;
  const auto ignore = [](size_t, const RenderedTile&, Renderer::Progress) {};
  for (const bool before : {true, false}) {
    std::stop_source stop;
    std::thread stopper;
    if (before)
      stop.request_stop();
    else
      stopper = std::thread([&] { stop.request_stop(); });
    const Status status = renderer->Render(large, TilesOf(large.crop), ignore, stop.get_token());
    REQUIRE_FALSE(status.has_value());
    CHECK(status.error().kind == ErrorKind::kCancelled);
    if (stopper.joinable()) stopper.join();
  }
  CHECK(renderer->Render(view, TilesOf(view.crop), ignore).has_value());
}

TEST_CASE("Calls from several threads share a renderer", "[renderer]") {
  const Row row;
  const auto renderer = MakeRenderer(row, row.largest(), 2);
  const View front = Seen({0, -20, 0}, {0, 10, 0}), behind = Seen({0, 40, 0}, {0, 10, 0});
  std::vector<std::thread> threads;
  std::atomic<int> wrong{0};
  for (int t = 0; t < 3; ++t)
    threads.emplace_back([&, t] {
      const View& view = t == 0 ? behind : front;
      const Blocks expected =
          t == 0 ? Blocks{BlockKey::Hot(2), BlockKey::Shading(2), BlockKey::Hot(3)}
                 : Blocks{BlockKey::Hot(0), BlockKey::Hot(1), BlockKey::Hot(2), BlockKey::Shading(2)};
      const Tile tile{kMiddle, 2};
      const Status status =
          renderer->Render(view, std::span(&tile, 1), [&](size_t, const RenderedTile& r, Renderer::Progress) {
            if (r.blocks != expected) ++wrong;
          });
      if (!status) ++wrong;
    });
  for (std::thread& thread : threads) thread.join();
  CHECK(wrong == 0);
}

}  // namespace quarry

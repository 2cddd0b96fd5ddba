#include "common/engine/tile_renderer.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <random>

#include "common/engine/blocks/loader.h"
#include "common/engine/integrators/hits.h"
#include "common/math/shared_exponent.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"

// Tiles rendered on the test's own thread: each step, and each block that comes, is the test's doing.

namespace quarry {
namespace {

using test::Looking;
using test::Row;
using Blocks = std::vector<BlockKey>;

constexpr PixelRect kMiddle{160, 128, 32, 32}, kCentre{144, 112, 32, 32};
constexpr uint32_t kPixels = 32 * 32;
constexpr float kWallY = 15, kEyeY = -20;

std::shared_ptr<const ViewContext> Context(const Row& row, const View& view) {
  return std::make_shared<ViewContext>(view, row.scene->catalog());
}

/// Before the wall, with the empty voxels in between.
View BeforeWall() { return Looking({0, kEyeY, 0}, {0, 10, 0}); }

/// With shadow rays and mirror rays that come to all voxels but the last.
View Mirrored() {
  View view = Looking({5, kEyeY, 3}, {3, 10, 4});
  view.mode = RenderMode::kWhitted;
  view.spp = 4;
  view.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  return view;
}

struct Wanted {
  BlockKey block;
  uint32_t rays;
  OctantMask octants;
};

/// A renderer, its cache, and a loader that goes on when the test says so.
class Bench {
 public:
  explicit Bench(const Row& row, uint64_t cache_bytes = 1 << 20)
      : row_(row),
        cache_(
            row.scene->catalog(), cache_bytes, [] {}, [] {}),
        source_{row.scene->store()},
        loader_(cache_, source_, [](const Error& e) { FAIL(e.message); }) {}

  void Open(const View& view, const Tile& tile) { renderer.Open(Context(row_, view), tile); }
  /// A step, and the blocks that rays have been parked on in it.
  std::vector<Wanted> Step() {
    std::vector<Wanted> wanted;
    renderer.Step(pins_, [&](BlockKey block, const RayBatch::Parked& parked) {
      wanted.push_back({block, parked.rays, parked.octants});
      cache_.Want(block, &mailbox_, parked.rays, parked.octants);
    });
    return wanted;
  }
  /// Steps until no ray can go on. Returns all that was wanted.
  std::vector<Wanted> StepOn() {
    std::vector<Wanted> all;
    for (int steps = 0; renderer.has_ready(); ++steps) {
      REQUIRE(steps < 10000);
      for (const Wanted& wanted : Step()) all.push_back(wanted);
    }
    return all;
  }
  /// Brings blocks that rays wait for, and resumes those rays: all that have room, in an order drawn by lot.
  void Bring() {
    pins_.Release();
    loader_.Run();
    Blocks came = mailbox_.Take(false);
    std::ranges::shuffle(came, random_);
    for (const BlockKey block : came) {
      pins_.Adopt(block);
      renderer.Resume(block);
    }
  }
  RenderedTile Render(const View& view, const Tile& tile) {
    Open(view, tile);
    return Finish();
  }
  /// The nearest hits of rays.
  RenderedTile Trace(std::vector<RayQuery> rays) {
    const auto count = static_cast<uint32_t>(rays.size());
    auto context = std::make_shared<ViewContext>(View(), row_.scene->catalog(), nullptr,
                                                 std::make_shared<const NearestHits>());
    renderer.Open(std::move(context), RayPart{std::make_shared<const RayVector>(std::move(rays)), 0, count});
    return Finish();
  }
  RenderedTile Finish() {
    for (int rounds = 0; !renderer.done(); ++rounds) {
      REQUIRE(rounds < 10000);
      StepOn();
      Bring();
    }
    return renderer.Take();
  }
  uint64_t evictions() const { return cache_.counters().evictions; }

  TileRenderer renderer;

 private:
  struct Source final : VoxelSource {
    explicit Source(const StoreReader& s) : store(s) {}
    void Fetch(BlockKey block, Done done) override { done(store.ReadBlock(block)); }
    const StoreReader& store;
  };
  const Row& row_;
  VoxelCache cache_;
  Source source_;
  Loader loader_;
  Mailbox mailbox_;
  PinnedBlocks pins_{cache_};
  std::mt19937 random_{1};
};

/// The rays through the middles of a view's pixels.
std::vector<RayQuery> EyeRaysThrough(const View& view, const PixelRect& pixels, const Row& row) {
  const SceneMeta& meta = row.scene->catalog().meta;
  const Camera camera(view.camera, view.width, view.height, meta.root_lower, meta.root_upper);
  std::vector<RayQuery> rays;
  for (uint32_t i = 0; i < pixels.width * pixels.height; ++i) {
    const PrimaryRay ray = camera.Shoot(pixels.x + i % pixels.width + 0.5, pixels.y + i / pixels.width + 0.5);
    rays.push_back({view.camera.eye, ray.direction});
  }
  return rays;
}

/// Word `word` of pixel (x, y) of a tile's pixels.
template <class T>
T WordAt(const RenderedTile& tile, uint32_t columns, uint32_t words, uint32_t x, uint32_t y, uint32_t word) {
  T value;
  static_assert(sizeof value == 4);
  std::memcpy(&value, &tile.pixels.at(4 * size_t{words * (y * columns + x) + word}), sizeof value);
  return value;
}

void CheckSame(const RenderedTile& a, const RenderedTile& b) {
  CHECK(a.pixels == b.pixels);
  CHECK(a.depths == b.depths);
  CHECK(a.blocks == b.blocks);
  CHECK(a.rays == b.rays);
}

/// Checks a tile against the wall, seen straight on from `eye_y`.
void CheckWall(double eye_y, double fov_degrees) {
  const Row row;
  View view = Looking({0, eye_y, 0}, {0, 10, 0});
  view.camera.fov_degrees = fov_degrees;
  view.aov_mask = 127;
  const uint32_t words = WordsPerPixel(view.aov_mask);
  Bench bench(row);
  const RenderedTile tile = bench.Render(view, {kCentre});
  const RenderedTile hits = bench.Trace(EyeRaysThrough(view, kCentre, row));
  REQUIRE(tile.pixels.size() == size_t{kPixels} * words * 4);
  REQUIRE(hits.hits.size() == kPixels);
  const double scale = 2 * std::tan(fov_degrees * 3.14159265358979 / 360) / view.height;
  const glm::vec3 albedo = row.scene->catalog().materials[0].base_color;
  for (uint32_t y = 0; y < 32; ++y)
    for (uint32_t x = 0; x < 32; ++x) {
      // The ray through the pixel's middle, one unit of y long.
      const double right = (kCentre.x + x + 0.5 - view.width / 2.0) * scale,
                   up = -(kCentre.y + y + 0.5 - view.height / 2.0) * scale;
      const double length = std::sqrt(1 + right * right + up * up), depth = (kWallY - eye_y) * length;
      const auto word = [&](uint32_t w) { return WordAt<uint32_t>(tile, 32, words, x, y, w); };
      const auto number = [&](uint32_t w) { return WordAt<float>(tile, 32, words, x, y, w); };
      // The wall's diagonal parts its two triangles; on it the lower id counts.
      const uint32_t triangle = right > up - 1e-9 ? 4 : 5;
      INFO("pixel " << x << ", " << y);
      CHECK(number(4) == Approx(depth).epsilon(1e-5));
      CHECK(number(6) == -1);  // the normal, toward the eye
      CHECK(word(10) == triangle);
      CHECK(word(11) == 0);  // material
      CHECK(word(12) == 0);  // part
      CHECK(word(13) == 2);  // voxel
      CHECK(hits.hits[32 * y + x].triangle == triangle);
      CHECK(hits.hits[32 * y + x].t == Approx(number(4)).epsilon(1e-6));
      CHECK(tile.depths.at(8 * (y / kDepthCell) + x / kDepthCell) >= number(4));
      // The headlight: albedo times the cosine between the ray and the wall's normal.
      for (uint32_t c = 0; c < 3; ++c)
        CHECK(number(c) == Approx(static_cast<double>(albedo[static_cast<int>(c)]) / length).epsilon(1e-4));
    }
}

}  // namespace

TEST_CASE("A tile has the hits and colours that geometry gives, from near and from far", "[tile_renderer]") {
  CheckWall(kEyeY, 45);
  CheckWall(-500, 4);
}

TEST_CASE("A tile shows the background where rays hit nothing, and its layers state it", "[tile_renderer]") {
  const Row row;
  View view = Looking({0, kEyeY, 0}, {0, -30, 0});
  view.aov_mask = 127;
  view.background = {0.25f, 0.5f, 0.75f};
  view.backdrop = false;
  Bench bench(row);
  const RenderedTile tile = bench.Render(view, {kMiddle});
  for (const uint32_t at : {0u, 17u, 31u}) {
    for (uint32_t c = 0; c < 3; ++c)
      CHECK(WordAt<float>(tile, 32, 14, at, at, c) == view.background[static_cast<int>(c)]);
    CHECK(WordAt<float>(tile, 32, 14, at, at, 3) == 1);
    CHECK(std::isinf(WordAt<float>(tile, 32, 14, at, at, 4)));
    for (const uint32_t word : {10u, 11u, 12u, 13u})
      CHECK(WordAt<uint32_t>(tile, 32, 14, at, at, word) == 0xFFFFFFFFu);
  }
  view.backdrop = true;
  const RenderedTile uncovered = bench.Render(view, {kMiddle});
  for (uint32_t c = 0; c < 4; ++c) CHECK(WordAt<float>(uncovered, 32, 14, 17, 17, c) == 0);
  Tile shown{kMiddle};
  shown.form = PixelForm::kShown;
  shown.samples = 1;
  CHECK(WordAt<uint32_t>(bench.Render(view, shown), 32, 1, 17, 17, 0) == kUncovered);
  CHECK(tile.rays == kPixels);
  CHECK(tile.rays_suspended == 0);
  CHECK(tile.blocks.empty());
}

TEST_CASE("A block is requested once for all waiting rays, and blocks one by one along the rays",
          "[tile_renderer]") {
  const Row row;
  Bench bench(row);
  bench.Open(BeforeWall(), {kMiddle});
  // The picture's part to the right of the middle and below it.
  const OctantMask forward = OctantBit(1, 1, -1);
  Blocks order;
  while (!bench.renderer.done()) {
    REQUIRE(order.size() < 8);
    const auto wanted = bench.StepOn();
    if (bench.renderer.done()) break;
    REQUIRE(wanted.size() == 1);
    CHECK(wanted[0].rays == kPixels);
    CHECK(wanted[0].octants == forward);
    order.push_back(wanted[0].block);
    // Nothing goes on before the block is there, or for another block.
    CHECK_FALSE(bench.renderer.has_ready());
    bench.renderer.Resume(BlockKey::Hot(3));
    CHECK_FALSE(bench.renderer.has_ready());
    bench.Bring();
    CHECK(bench.renderer.has_ready());
  }
  CHECK(order == Blocks{BlockKey::Hot(0), BlockKey::Hot(1), BlockKey::Hot(2), BlockKey::Shading(2)});
  const RenderedTile tile = bench.renderer.Take();
  CHECK(tile.rays == kPixels);
  CHECK(tile.rays_suspended == 4 * kPixels);
}

TEST_CASE("A tile whose blocks are resident does not wait, and has the same bytes", "[tile_renderer]") {
  const Row row;
  Bench bench(row);
  const RenderedTile first = bench.Render(Mirrored(), {kMiddle});
  CHECK(first.rays_suspended > 0);
  bench.Open(Mirrored(), {kMiddle});
  CHECK(bench.StepOn().empty());
  REQUIRE(bench.renderer.done());
  const RenderedTile second = bench.renderer.Take();
  CHECK(second.rays_suspended == 0);
  CheckSame(first, second);
}

TEST_CASE("A cache of one block, or another order of blocks, changes no byte of a tile", "[tile_renderer]") {
  const Row row;
  for (View view : {BeforeWall(), Mirrored()}) {
    view.aov_mask = 127;
    Bench large(row), small(row, row.largest());
    const RenderedTile expected = large.Render(view, {kMiddle});
    for (int again = 0; again < 3; ++again) CheckSame(small.Render(view, {kMiddle}), expected);
    CHECK(large.evictions() == 0);
    CHECK(small.evictions() > 3);
  }
}

TEST_CASE("A lattice at the picture's edge stays inside, and its points are pixels of the whole tile",
          "[tile_renderer]") {
  const Row row;
  View view = Mirrored();
  view.spp = 1;
  const PixelRect edge{view.width - 30, view.height - 27, 30, 27};
  Bench bench(row);
  const RenderedTile all = bench.Render(view, {edge});
  for (const uint32_t step : {1u, 4u, 5u, 8u}) {
    const Tile lattice{edge, step};
    const RenderedTile some = bench.Render(view, lattice);
    REQUIRE(some.pixels.size() == size_t{lattice.columns()} * lattice.rows() * 16);
    CHECK(some.depths.size() == size_t{DepthCells(lattice.columns())} * DepthCells(lattice.rows()));
    for (uint32_t y = 0; y < lattice.rows(); ++y)
      for (uint32_t x = 0; x < lattice.columns(); ++x) {
        const uint32_t px = std::min(x * step + step / 2, edge.width - 1),
                       py = std::min(y * step + step / 2, edge.height - 1);
        INFO("step " << step << ", point " << x << ", " << y);
        for (uint32_t c = 0; c < 3; ++c)
          CHECK(WordAt<float>(some, lattice.columns(), 4, x, y, c) ==
                WordAt<float>(all, edge.width, 4, px, py, c));
      }
  }
}

TEST_CASE("Rays of a list have the hits of eye rays, without shading", "[tile_renderer]") {
  const Row row;
  const View view = Mirrored();
  View layers = view;
  layers.aov_mask = 1u << static_cast<int>(Aov::kPrimitive) | 1u << static_cast<int>(Aov::kDepth);
  Bench bench(row);
  const RenderedTile hits = bench.Trace(EyeRaysThrough(view, kMiddle, row)),
                     all = bench.Render(layers, {kMiddle});
  CHECK(hits.pixels.empty());
  CHECK(hits.rays == kPixels);
  REQUIRE(hits.hits.size() == kPixels);
  for (uint32_t i = 0; i < kPixels; ++i) {
    CHECK(hits.hits[i].t == Approx(WordAt<float>(all, 32, 6, i % 32, i / 32, 4)).epsilon(1e-6));
    CHECK(hits.hits[i].triangle == WordAt<uint32_t>(all, 32, 6, i % 32, i / 32, 5));
  }
  CHECK(hits.blocks == Blocks{BlockKey::Hot(0), BlockKey::Hot(1), BlockKey::Hot(2)});
}

TEST_CASE("A tile counts the rays of all its samples and the rays that surfaces send on", "[tile_renderer]") {
  const Row row;
  Bench bench(row);
  View view = BeforeWall();
  for (const uint32_t spp : {1u, 3u}) {
    view.spp = spp;
    view.mode = RenderMode::kRaycast;
    CHECK(bench.Render(view, {kMiddle}).rays == spp * kPixels);
    view.mode = RenderMode::kShadow;
    view.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
    CHECK(bench.Render(view, {kMiddle}).rays == 2 * spp * kPixels);
    view.lights = {{LightKind::kSun, {0, 1, 0}, glm::vec3(1)}};  // behind the wall: no ray is sent
    CHECK(bench.Render(view, {kMiddle}).rays == spp * kPixels);
    view.mode = RenderMode::kWhitted;  // the mirror's
    CHECK(bench.Render(view, {kMiddle}).rays == 2 * spp * kPixels);
  }
}

TEST_CASE("An abandoned tile ends at once, and leaves nothing to the next", "[tile_renderer]") {
  const Row row;
  const RenderedTile expected = Bench(row).Render(BeforeWall(), {kMiddle});
  for (int steps = 0; steps < 4; ++steps) {
    Bench bench(row);  // without blocks
    bench.Open(Mirrored(), {kMiddle});
    for (int s = 0; s < steps; ++s) {
      bench.StepOn();
      if (s + 1 < steps) bench.Bring();
    }
    bench.renderer.Abandon();
    CHECK(bench.renderer.done());
    CHECK_FALSE(bench.renderer.has_ready());
    bench.Bring();  // of blocks that the abandoned rays waited for
    CHECK_FALSE(bench.renderer.has_ready());
    (void)bench.renderer.Take();
    const RenderedTile next = bench.Render(BeforeWall(), {kMiddle});
    CheckSame(next, expected);
  }
}

TEST_CASE("A tile's memory is fixed when it is opened, and within the engine's allowance",
          "[tile_renderer]") {
  const Row row;
  for (const View& view : {BeforeWall(), Mirrored()}) {
    Bench bench(row);
    bench.Open(view, {kMiddle});
    const size_t opened = bench.renderer.memory_bytes();
    CHECK(opened <= (view.mode == RenderMode::kWhitted ? 676u << 10 : 255u << 10));
    while (!bench.renderer.done()) {
      bench.StepOn();
      CHECK(bench.renderer.memory_bytes() == opened);
      bench.Bring();
    }
  }
}

TEST_CASE("Nested lattices trace each pixel once, as the first sample of the whole tile",
          "[renderer][live]") {
  const Row row;
  View view = Mirrored();
  view.spp = 1;
  const PixelRect cut{150, 118, 61, 47};  // squares are cut at its right and lower border
  Bench bench(row);
  const RenderedTile whole = bench.Render(view, {cut});
  std::vector<int> traced(size_t{cut.width} * cut.height);
  const auto trace = [&](uint32_t step, uint32_t x, uint32_t y) {
    Tile tile{cut, step};
    tile.phase_x = x;
    tile.phase_y = y;
    const RenderedTile part = bench.Render(view, tile);
    REQUIRE(part.pixels.size() == size_t{16} * tile.columns() * tile.rows());
    for (uint32_t r = 0; r < tile.rows(); ++r)
      for (uint32_t c = 0; c < tile.columns(); ++c) {
        const uint32_t px = tile.X(c) - cut.x, py = tile.Y(r) - cut.y;
        ++traced.at(py * cut.width + px);
        for (uint32_t w = 0; w < 4; ++w)
          REQUIRE(WordAt<uint32_t>(part, tile.columns(), 4, c, r, w) ==
                  WordAt<uint32_t>(whole, cut.width, 4, px, py, w));
      }
  };
  trace(4, 0, 0);
  for (const auto& [step, far] : {std::pair(4u, 2u), std::pair(2u, 1u)}) {
    trace(step, far, 0);
    trace(step, 0, far);
    trace(step, far, far);
  }
  CHECK(std::ranges::all_of(traced, [](int times) { return times == 1; }));
}

TEST_CASE("Sums of ranges of samples add up to the sum of all", "[renderer][live]") {
  const Row row;
  View view = Mirrored();
  view.aov_mask = 1;  // depth, with the first range
  Bench bench(row);
  const RenderedTile whole = bench.Render(view, {kCentre});
  std::vector<FixedRadiance> sums(4 * size_t{kPixels});
  std::vector<uint32_t> depths(kPixels);
  for (const auto& [first, count] : {std::pair(3u, 1u), std::pair(0u, 1u), std::pair(1u, 2u)}) {
    Tile tile{kCentre};
    tile.first_sample = first;
    tile.samples = count;
    tile.form = PixelForm::kSums;
    const RenderedTile part = bench.Render(view, tile);
    REQUIRE(part.pixels.size() == size_t{kPixels} * 36);
    for (size_t p = 0; p < kPixels; ++p) {
      int64_t sum[4];
      std::memcpy(sum, part.pixels.data() + 36 * p, sizeof sum);
      for (size_t c = 0; c < 4; ++c) sums[4 * p + c].Add(FixedRadiance::FromBits(sum[c]));
      if (first == 0) std::memcpy(&depths[p], part.pixels.data() + 36 * p + 32, 4);
    }
  }
  for (uint32_t p = 0; p < kPixels; ++p) {
    for (uint32_t c = 0; c < 4; ++c)
      REQUIRE(WordAt<float>(whole, 32, 5, p % 32, p / 32, c) == sums[4 * size_t{p} + c].Mean(view.spp));
    REQUIRE(WordAt<uint32_t>(whole, 32, 5, p % 32, p / 32, 4) == depths[p]);
  }
}

TEST_CASE("A picture in motion is near the mean, and waiting rays leave holes", "[renderer][live]") {
  const Row row;
  View view = Mirrored();
  view.spp = 1;
  Tile tile{kCentre};
  tile.form = PixelForm::kShown;
  tile.leaves_holes = true;
  tile.samples = 1;
  Bench bench(row);
  bench.Open(view, tile);
  bench.StepOn();
  REQUIRE(bench.renderer.may_leave_holes());
  bench.renderer.LeaveHoles();
  REQUIRE(bench.renderer.done());
  const RenderedTile early = bench.renderer.Take();
  CHECK(early.holes > 0);
  REQUIRE(early.pixels.size() == size_t{kPixels} * 4);
  uint32_t holes = 0;
  for (uint32_t p = 0; p < kPixels; ++p)
    holes += WordAt<uint32_t>(early, 32, 1, p % 32, p / 32, 0) == kHole ? 1 : 0;
  CHECK(holes == early.holes);

  const RenderedTile whole = bench.Render(view, {kCentre});
  const RenderedTile shown = bench.Render(view, tile);
  CHECK(shown.holes == 0);
  for (uint32_t p = 0; p < kPixels; ++p) {
    const auto code = WordAt<uint32_t>(shown, 32, 1, p % 32, p / 32, 0);
    REQUIRE((code == kUncovered) == (WordAt<float>(whole, 32, 4, p % 32, p / 32, 3) == 0));
    if (code == kUncovered) continue;
    const glm::vec3 color = UnpackShared(code);
    float most = 0;
    for (uint32_t c = 0; c < 3; ++c) most = std::max(most, WordAt<float>(whole, 32, 4, p % 32, p / 32, c));
    for (uint32_t c = 0; c < 3; ++c)
      REQUIRE(std::fabs(color[static_cast<int>(c)] - WordAt<float>(whole, 32, 4, p % 32, p / 32, c)) <=
              most / 512);
  }
}

TEST_CASE("A tile of many packets leaves holes packet by packet", "[renderer][live]") {
  const Row row;
  const View view = BeforeWall();
  Tile tile{{96, 64, 96, 80}};
  tile.form = PixelForm::kShown;
  tile.leaves_holes = true;
  tile.samples = 1;
  Bench bench(row);
  bench.Open(view, tile);
  bench.StepOn();
  CHECK(bench.renderer.may_leave_holes());
  bench.renderer.LeaveHoles();
  const RenderedTile early = bench.renderer.Take();
  CHECK(early.holes > 96 * 80 / 2);
  CHECK(early.rays == 96 * 80);  // none was left out
  bench.Bring();                 // blocks that nobody waits for any more
  CHECK_FALSE(bench.renderer.has_ready());
  Tile whole = tile;
  whole.leaves_holes = false;
  const RenderedTile all = bench.Render(view, whole);
  const RenderedTile again = bench.Render(view, tile);
  CHECK(again.holes == 0);
  CHECK(again.pixels == all.pixels);
}

TEST_CASE("Colours with a shared exponent are decoded to the same colours", "[renderer][live]") {
  for (const float v : {0.0f, 1e-9f, 1e-5f, 0.18f, 0.999f, 1.0f, 511.9f, 512.0f, 65280.0f, 1e9f}) {
    const glm::vec3 back = UnpackShared(PackShared({v, v / 2, 0}));
    const float wanted = std::min(v, kMostShared);
    CHECK(std::fabs(back.x - wanted) <= std::max(wanted / 1000, 0x1p-25f));
    CHECK(back.z == 0);
    CHECK(PackShared({v, v, v}) != kHole);
    CHECK(PackShared(back) == PackShared({v, v / 2, 0}));
  }
  CHECK(UnpackShared(PackShared({NAN, -1, 2})) == glm::vec3(0, 0, 2));
}

}  // namespace quarry

#include "master/schedule/coarse_rays.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <condition_variable>
#include <mutex>
#include <optional>

#include "common/voxel/store_writer.h"
#include "master/schedule/footprint_probe.h"
#include "tests/support/looking.h"
#include "tests/support/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::Looking;

/// Two triangles, as a voxel of the cell from y to y + 10; -20 to 20 across.
HotVoxel Voxel(float y, const std::vector<glm::vec3>& vertices, uint32_t first_id) {
  HotVoxel v;
  v.cell = {{-20, y, -20}, {20, y + 10, 20}};
  v.nodes = {KdNode::Leaf(0, 2)};
  v.node_slots = 4;
  v.wide_nodes = 1;
  v.references = {0, 1};
  v.vertices = vertices;
  v.corners = {0, 1, 2, 3, 4, 5};
  v.triangle_ids = {first_id, first_id + 1};
  v.materials = {0, 0};
  v.parts = {0, 0};
  return v;
}

/// Nothing but a triangle in two corners of the cell, so that rays pass through it.
HotVoxel Open(float y, uint32_t first_id) {
  return Voxel(
      y, {{-20, y, -20}, {-19, y, -20}, {-20, y, -19}, {20, y + 10, 20}, {19, y + 10, 20}, {20, y + 10, 19}},
      first_id);
}

/// Four voxels in a row along y, from -10 to 30; the third holds a wall at 15, a mirror, with attributes.
struct Row {
  explicit Row(uint16_t material = 0) {
    auto writer = StoreWriter::Create(folder.file("s"));
    REQUIRE(writer.has_value());
    const std::vector<glm::vec3> wall{{-20, 15, -20}, {20, 15, -20}, {20, 15, 20},
                                      {-20, 15, -20}, {20, 15, 20},  {-20, 15, 20}};
    ShadingVoxel shading;
    shading.corners = {0, 0, 0, 0, 0, 0};
    shading.vertices = {{{0, -1, 0}, {0, 0}, 0xFFFFFFFFu}};
    for (uint32_t v = 0; v < 4; ++v) {
      const float y = 10 * static_cast<float>(v) - 10;
      HotVoxel hot = v == 2 ? Voxel(y, wall, 2 * v) : Open(y, 2 * v);
      if (v == 2) hot.materials[0] = material;
      REQUIRE(writer->AddVoxel(EncodeVoxel(hot, v == 2 ? &shading : nullptr)).has_value());
    }
    SceneMeta meta;
    meta.bounds_lower = meta.root_lower = {-20, -10, -20};
    meta.bounds_upper = meta.root_upper = {20, 30, 20};
    meta.padding = 1e-4f;
    meta.input_triangles = 8;
    meta.voxel_size = 1 << 16;
    Material mirror{"mirror"};
    mirror.reflectance = glm::vec3(1);
    REQUIRE(writer
                ->Finish(meta,
                         {KdNode::Inner(1, 10, 1), KdNode::Inner(1, 0, 3), KdNode::Inner(1, 20, 5),
                          KdNode::Leaf(0, 1), KdNode::Leaf(1, 1), KdNode::Leaf(2, 1), KdNode::Leaf(3, 1)},
                         {mirror}, {"part"})
                .has_value());
    auto opened = StoreReader::Open(folder.file("s"));
    REQUIRE(opened.has_value());
    store.emplace(std::move(*opened));
  }
  uint64_t largest() const { return store->catalog().meta.largest_decoded; }

  test::TemporaryFolder folder;
  std::optional<StoreReader> store;
};

using Blocks = std::vector<uint32_t>;
constexpr Frame::Tile kMiddle{160, 128, 32, 32};

}  // namespace

TEST_CASE("Coarse rays come to the voxels before what they hit, and to its attributes", "[coarse]") {
  const Row row;
  CoarseRays rays(*row.store, 1 << 20);
  RenderJob job = Looking({0, -20, 0}, {0, 10, 0});
  const auto tile = rays.Trace(job, kMiddle);
  REQUIRE(tile.has_value());
  CHECK(tile->blocks == Blocks{0, 2, 4, 5});
  REQUIRE(tile->depths.size() == 256);
  for (const float depth : tile->depths) CHECK(depth == Approx(35).epsilon(0.02));
  job.mode = RenderMode::kVoxels;  // no attributes
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{0, 2, 4});
  // The other way there is nothing.
  const auto empty = rays.Trace(Looking({0, -20, 0}, {0, -30, 0}), kMiddle);
  CHECK(empty->blocks.empty());
  for (const float depth : empty->depths) CHECK(std::isinf(depth));
  // From behind the wall: its other side, and the voxel that nobody came to from the front.
  CHECK(rays.Trace(Looking({0, 40, 0}, {0, 10, 0}), kMiddle)->blocks == Blocks{4, 5, 6});
}

TEST_CASE("Rays that a mode sends on are sent on", "[coarse]") {
  const Row row;
  CoarseRays rays(*row.store, 1 << 20);
  // Close before the wall, past the voxels that lie before it.
  RenderJob job = Looking({0, 12, 0}, {0, 20, 0});
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{4, 5});
  job.mode = RenderMode::kShadow;
  job.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{0, 2, 4, 5});
  job.lights = {{LightKind::kPoint, {0, 5, 0}, glm::vec3(1)}};  // no farther than that
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{2, 4, 5});
  job.lights = {{LightKind::kSun, {0, 1, 0}, glm::vec3(1)}};  // on the other side
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{4, 5});
  job.mode = RenderMode::kWhitted;
  CHECK(rays.Trace(job, kMiddle)->blocks == Blocks{0, 2, 4, 5});
}

TEST_CASE("A cache of one voxel finds the same, and holds no more", "[coarse]") {
  const Row row;
  CoarseRays rays(*row.store, 1 << 20), small(*row.store, row.largest());
  RenderJob job = Looking({0, -20, 0}, {3, 10, 4});
  job.mode = RenderMode::kWhitted;
  job.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  for (const Frame::Tile& tile : Frame::TilesOf(job)) {
    const auto one = rays.Trace(job, tile), other = small.Trace(job, tile);
    REQUIRE(one.has_value());
    REQUIRE(other.has_value());
    CHECK(one->blocks == other->blocks);
    CHECK(one->depths == other->depths);
    CHECK(small.cache_bytes() <= row.largest());
  }
}

TEST_CASE("A store that is damaged meanwhile ends with its sentence", "[coarse]") {
  const Row row;
  CoarseRays rays(*row.store, 1 << 20);
  auto bytes = test::ReadFile(row.store->path());
  for (size_t i = 200; i < bytes.size(); ++i) bytes[i] = static_cast<char>(~bytes[i]);
  test::WriteFile(row.store->path(), bytes);
  const auto tile = rays.Trace(Looking({0, -20, 0}, {0, 10, 0}), kMiddle);
  REQUIRE_FALSE(tile.has_value());
  CHECK(tile.error().message.find(row.store->path()) != std::string::npos);
}

TEST_CASE("A voxel that names a material that the scene lacks is not believed", "[coarse]") {
  const Row row(1);
  CHECK_THAT(row.store->Verify([](size_t, size_t) {}).error().message,
             Catch::Contains("it names a material that the scene lacks"));
  CoarseRays rays(*row.store, 1 << 20);
  const auto tile = rays.Trace(Looking({0, -20, 0}, {0, 10, 0}), kMiddle);
  REQUIRE_FALSE(tile.has_value());
  CHECK_THAT(tile.error().message, Catch::Contains(row.store->path()) && Catch::Contains("block 4"));
}

TEST_CASE("Frames are foreseen in the order in which they are wanted, and forgotten when they are not",
          "[coarse]") {
  const Row row;
  std::mutex mutex;
  std::condition_variable told;
  int news = 0;
  FootprintProbe foresight(*row.store, 1 << 20, [&] {
    const std::lock_guard lock(mutex);
    ++news;
    told.notify_one();
  });
  const auto await = [&](int count) {
    std::unique_lock lock(mutex);
    REQUIRE(told.wait_for(lock, std::chrono::seconds(60), [&] { return news >= count; }));
  };
  const RenderJob front = Looking({0, -20, 0}, {0, 10, 0}), back = Looking({0, 40, 0}, {0, 10, 0});
  CHECK(foresight.Find("j", 0) == nullptr);
  CHECK_FALSE(foresight.IsAtWork("j", 0));
  foresight.Want({{"j", 0, front}, {"j", 1, back}});
  await(2);
  const auto first = foresight.Find("j", 0), second = foresight.Find("j", 1);
  REQUIRE(first);
  REQUIRE(second);
  CHECK_FALSE(foresight.IsAtWork("j", 1));
  CHECK(foresight.Find("other", 0) == nullptr);
  CoarseRays rays(*row.store, 1 << 20);
  const auto tiles = Frame::TilesOf(front);
  REQUIRE(first->size() == tiles.size());
  for (size_t t = 0; t < tiles.size(); ++t) {
    CHECK((*first)[t].blocks == rays.Trace(front, tiles[t])->blocks);
    CHECK((*second)[t].blocks == rays.Trace(back, tiles[t])->blocks);
  }
  // What is known stays known while it is wanted.
  foresight.Want({{"j", 1, back}, {"j", 2, front}});
  CHECK(foresight.Find("j", 1) == second);
  CHECK(foresight.Find("j", 0) == nullptr);
  await(3);
  CHECK(foresight.Find("j", 2) != nullptr);
}

}  // namespace quarry

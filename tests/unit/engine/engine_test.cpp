#include "common/engine/engine.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <thread>

#include "common/engine/renderer.h"
#include "tests/support/rendering/looking.h"
#include "tests/support/rendering/row_scene.h"

namespace quarry {
namespace {

using namespace std::chrono_literals;
using test::Looking;
using test::Row;

constexpr PixelRect kMiddle{160, 128, 32, 32};
constexpr auto kMost = 60s;  ///< until a test gives up

View Seen(const glm::dvec3& eye, const glm::dvec3& at) { return Looking(eye, at); }
View Front() { return Seen({0, -20, 0}, {0, 10, 0}); }
View Mirrored() {
  View view = Seen({5, -20, 3}, {3, 10, 4});
  view.mode = RenderMode::kWhitted;
  view.lights = {{LightKind::kSun, {0, -1, 0}, glm::vec3(1)}};
  return view;
}

template <class Condition>
void Await(Condition condition) {
  const auto end = std::chrono::steady_clock::now() + kMost;
  while (!condition() && std::chrono::steady_clock::now() < end) std::this_thread::sleep_for(1ms);
  REQUIRE(condition());
}

/// A store's blocks: at once, or while held when Release is called; those from the `fails_from`th fail, or
/// have a wrong byte. Used from the loader's thread, but for the atomics.
class HeldSource final : public VoxelSource {
 public:
  explicit HeldSource(const StoreReader& store) : store_(store) {}
  void Fetch(BlockKey block, Done done) override {
    const uint32_t number = asked++;
    if (held) return waiting_.push_back([this, block, number, done] { Answer(block, number, done); });
    Answer(block, number, done);
  }
  void Release() {
    held = false;
    for (const auto& answer : std::exchange(waiting_, {})) answer();
  }
  std::atomic<bool> held{false};
  std::atomic<uint32_t> asked{0}, fails_from{~0u}, wrong_from{~0u};

 private:
  void Answer(BlockKey block, uint32_t number, const Done& done) {
    if (number >= fails_from) return done(Fail("the test's fault"));
    auto bytes = store_.ReadBlock(block);
    if (number >= wrong_from) std::ranges::fill(*bytes, std::byte{0xA5});
    done(std::move(bytes));
  }
  const StoreReader& store_;
  std::vector<std::function<void()>> waiting_;
};

/// An engine with its cache, its loader and the loader's thread.
struct Works {
  explicit Works(const Row& a_row, unsigned threads = 1, uint64_t cache_bytes = 1 << 20) : row(a_row) {
    Renderer::Hooks hooks;
    hooks.on_error = [this](const Error& error) {
      last_error = error.message;
      ++errors;
    };
    auto made = Renderer::Create(
        row.scene->catalog(), source, [this](std::function<void()> task) { tasks.Post(std::move(task)); },
        {cache_bytes, threads}, std::move(hooks));
    REQUIRE(made.has_value());
    renderer = std::move(*made);
    loading = std::thread([this] { tasks.Run(); });
  }
  ~Works() {
    tasks.Stop();
    loading.join();
  }
  void Release() {
    tasks.Post([this] { source.Release(); });
  }
  /// Until a block has been asked for, so that a tile has been begun.
  void AwaitAsked() {
    Await([this] { return source.asked > 0; });
  }

  const Row& row;
  HeldSource source{row.scene->store()};
  TaskQueue tasks;
  std::thread loading;
  std::atomic<int> errors{0};
  std::string last_error;  ///< the loader thread's, until `errors` counts it
  std::unique_ptr<Renderer> renderer;
};

/// The tiles that have been done, by view.
class Results {
 public:
  /// For tile `index` of the view. The token lives as long as the engine may call it.
  Engine::OnTile For(uint64_t view, size_t index, std::shared_ptr<int> token = {}) {
    return [this, view, index, token = std::move(token)](RenderedTile tile) {
      const std::lock_guard lock(mutex_);
      if (!tiles_[view].emplace(index, std::move(tile)).second) tiles_[view][~index] = {};  // twice
      changed_.notify_all();
    };
  }
  size_t count(uint64_t view) {
    const std::lock_guard lock(mutex_);
    return tiles_[view].size();
  }
  std::map<size_t, RenderedTile> Await(uint64_t view, size_t tiles) {
    std::unique_lock lock(mutex_);
    REQUIRE(changed_.wait_for(lock, kMost, [&] { return tiles_[view].size() >= tiles; }));
    REQUIRE(tiles_[view].size() == tiles);
    return tiles_[view];
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::map<uint64_t, std::map<size_t, RenderedTile>> tiles_;
};

std::vector<Bytes> RenderedAlone(const Row& row, const View& view, const std::vector<Tile>& tiles) {
  auto renderer = Renderer::Create(*row.scene, {1 << 20, 1});
  REQUIRE(renderer.has_value());
  std::vector<Bytes> pixels(tiles.size());
  REQUIRE((*renderer)
              ->Render(view, tiles,
                       [&](size_t i, RenderedTile tile, Renderer::Progress) { pixels[i] = tile.pixels; })
              .has_value());
  return pixels;
}

}  // namespace

TEST_CASE("A tile of an unknown view is released at once, and never done", "[engine]") {
  const Row row;
  Results results;
  Works works(row);
  works.renderer->SetView(5, Front());
  works.renderer->DropViews(5, 6);
  for (const uint64_t view : {4, 5, 6}) {
    auto token = std::make_shared<int>();
    works.renderer->Order(view, {kMiddle}, results.For(view, 0, token));
    CHECK(token.use_count() == 1);
  }
  works.renderer->SetView(7, Front());
  works.renderer->Order(7, {kMiddle}, results.For(7, 0));
  results.Await(7, 1);
  for (const uint64_t view : {4, 5, 6}) CHECK(results.count(view) == 0);
}

TEST_CASE("Tiles of several views at once each show their own view", "[engine]") {
  const Row row;
  View voxels = Seen({0, 40, 0}, {0, 10, 0});
  voxels.mode = RenderMode::kVoxels;
  const View views[] = {Front(), Mirrored(), voxels};
  const std::vector<Tile> tiles = TilesOf({96, 64, 128, 128});
  for (const unsigned threads : {1u, 3u}) {
    Results results;
    Works works(row, threads, row.largest());
    for (uint64_t v = 0; v < 3; ++v) works.renderer->SetView(v, views[v]);
    for (size_t i = 0; i < tiles.size(); ++i)
      for (uint64_t v = 0; v < 3; ++v) works.renderer->Order(v, tiles[i], results.For(v, i));
    for (uint64_t v = 0; v < 3; ++v) {
      const auto rendered = results.Await(v, tiles.size());
      const auto alone = RenderedAlone(row, views[v], tiles);
      for (size_t i = 0; i < tiles.size(); ++i) CHECK(rendered.at(i).pixels == alone[i]);
    }
  }
}

TEST_CASE("Tiles of dropped views are never done, queued or begun; others are", "[engine]") {
  const Row row;
  Results results;
  Works works(row);
  works.source.held = true;
  constexpr size_t kTiles = 3 * Engine::kMostOpenTiles;  // more than a thread opens
  std::map<uint64_t, std::weak_ptr<int>> tokens;
  for (const uint64_t view : {1, 2, 3}) {
    auto token = std::make_shared<int>();
    tokens[view] = token;
    works.renderer->SetView(view, Front());
    for (size_t i = 0; i < kTiles; ++i) works.renderer->Order(view, {kMiddle}, results.For(view, i, token));
  }
  works.AwaitAsked();
  works.renderer->DropViews(50, 60);  // there are none
  works.renderer->DropViews(1, 3);    // not the third
  // Begun tiles let go too, though their blocks never came.
  Await([&] { return tokens[1].expired(); });
  Await([&] { return tokens[2].expired(); });
  CHECK_FALSE(tokens[3].expired());
  works.Release();
  results.Await(3, kTiles);
  CHECK(results.count(1) == 0);
  CHECK(results.count(2) == 0);
}

TEST_CASE("Queued tiles are given back at once, and begun ones are done", "[engine]") {
  const Row row;
  Results results;
  Works works(row);
  works.source.held = true;
  constexpr size_t kTiles = 3 * Engine::kMostOpenTiles;  // more than a thread opens
  works.renderer->SetView(1, Front());
  for (size_t i = 0; i < kTiles; ++i) works.renderer->Order(1, {kMiddle}, results.For(1, i));
  works.AwaitAsked();
  CHECK(works.renderer->has_open());
  works.renderer->GiveBackQueued();
  const size_t given_back = results.count(1);
  CHECK((given_back > 0 && given_back < kTiles));
  works.Release();
  size_t begun = 0;
  for (const auto& [i, tile] : results.Await(1, kTiles)) {
    begun += tile.begun ? 1 : 0;
    CHECK(tile.pixels.empty() != tile.begun);
  }
  CHECK(begun == kTiles - given_back);
  Await([&] { return !works.renderer->has_open(); });
}

TEST_CASE("An engine ends while its tiles wait for blocks", "[engine]") {
  const Row row;
  Results results;
  auto token = std::make_shared<int>();
  {
    Works works(row, 2);
    works.source.held = true;
    works.renderer->SetView(1, Front());
    for (size_t i = 0; i < 30; ++i) works.renderer->Order(1, {kMiddle}, results.For(1, i, token));
    works.AwaitAsked();
  }
  CHECK(token.use_count() == 1);
  CHECK(results.count(1) == 0);
}

TEST_CASE("Rays are counted tile by tile, and waiting is no computing", "[engine]") {
  const Row row;
  Results results;
  Works works(row);
  works.source.held = true;
  works.renderer->SetView(1, Front());
  works.renderer->Order(1, {kMiddle}, results.For(1, 0));
  works.AwaitAsked();
  const auto held = 500ms;
  std::this_thread::sleep_for(held);
  CHECK(works.renderer->counters().rays == 0);
  works.Release();
  const auto first = results.Await(1, 1);
  const auto held_us = static_cast<uint64_t>(std::chrono::microseconds(held).count());
  CHECK(works.renderer->counters().stall_us > held_us / 2);
  CHECK(works.renderer->counters().compute_us < held_us / 2);
  CHECK(first.at(0).compute_us < held_us / 2);
  CHECK(works.renderer->counters().rays == 1024);
  CHECK(works.renderer->counters().rays_suspended == 4 * 1024);
  works.renderer->Order(1, {kMiddle, 4}, results.For(1, 1));
  const auto second = results.Await(1, 2);
  CHECK(second.at(1).rays == 64);
  CHECK(works.renderer->counters().rays == 1024 + 64);
  CHECK(works.renderer->counters().rays_suspended == 4 * 1024);
}

TEST_CASE("A block that cannot be loaded is an error of every call", "[engine]") {
  const Row row;
  const View view = Mirrored();
  const std::vector<Tile> tiles = TilesOf(view.crop);
  const auto ignore = [](size_t, const RenderedTile&, Renderer::Progress) {};
  for (const bool wrong : {false, true})
    for (uint32_t from = 0; from < 4; ++from) {
      INFO("from block " << from << (wrong ? " wrong" : " missing"));
      Results results;
      Works works(row, 2);
      (wrong ? works.source.wrong_from : works.source.fails_from) = from;
      works.renderer->SetView(1, view);
      auto token = std::make_shared<int>();
      for (size_t i = 0; i < tiles.size(); ++i) works.renderer->Order(1, tiles[i], results.For(1, i, token));
      for (int call = 0; call < 2; ++call) {
        const Status status = works.renderer->Render(view, tiles, ignore);
        REQUIRE_FALSE(status.has_value());
        CHECK_THAT(status.error().message, Catch::Contains(wrong ? "block " : "the test's fault"));
      }
      Await([&] { return works.errors > 0; });
      CHECK(works.errors == 1);
      CHECK(works.last_error.find(wrong ? "block " : "the test's fault") != std::string::npos);
      // Tiles that wait in vain are let go of with their view.
      works.renderer->DropViews(1, 2);
      std::weak_ptr<int> waiting = std::exchange(token, nullptr);
      Await([&] { return waiting.expired(); });
      CHECK(results.count(1) < tiles.size());
    }
}

}  // namespace quarry

#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "common/engine/renderer.h"
#include "common/voxel/store_reader.h"

namespace quarry::test {

/// The result of rendering a frame.
struct EngineRun {
  bool ended = false;  ///< whether it ended in time
  uint64_t loads = 0;
  std::vector<Bytes> tiles;  ///< pixels, by tile
};

/// A source that answers some requests at once and others later, in a random order. Used from the loader's
/// thread.
class ShuffledSource final : public VoxelSource {
 public:
  ShuffledSource(const StoreReader& store, uint32_t seed) : store_(store), random_(seed) {}
  void Fetch(BlockKey block, Done done) override {
    if (random_() % 4 == 0) return done(store_.ReadBlock(block));
    waiting_.emplace_back(block, std::move(done));
  }
  /// Answers a random waiting request. Returns: false when there is none.
  bool Answer() {
    if (waiting_.empty()) return false;
    std::swap(waiting_[random_() % waiting_.size()], waiting_.back());
    auto [block, done] = std::move(waiting_.back());
    waiting_.pop_back();
    done(store_.ReadBlock(block));
    return true;
  }

 private:
  const StoreReader& store_;
  std::mt19937 random_;
  std::vector<std::pair<BlockKey, Done>> waiting_;
};

/// Renders the view with `threads` threads and a cold cache of `cache_bytes`.
inline EngineRun RunEngine(const StoreReader& store, const View& view, uint64_t cache_bytes, unsigned threads,
                           std::chrono::seconds most) {
  TaskQueue tasks;
  std::thread loading([&] { tasks.Run(); });
  ShuffledSource source(store, threads);
  Renderer::Hooks hooks;
  hooks.on_idle = [&] {
    while (source.Answer()) {
    }
  };
  const auto renderer = Renderer::Create(
      store.catalog(), source, [&](std::function<void()> task) { tasks.Post(std::move(task)); },
      {cache_bytes, threads}, std::move(hooks));
  REQUIRE(renderer.has_value());
  const std::vector<Tile> tiles = TilesOf(view.crop);
  EngineRun run;
  run.tiles.resize(tiles.size());
  std::stop_source stop;
  std::jthread alarm([&](std::stop_token done) {
    std::mutex mutex;
    std::unique_lock lock(mutex);
    if (!std::condition_variable_any().wait_for(lock, done, most, [&] { return done.stop_requested(); }))
      stop.request_stop();
  });
  const Status status = (*renderer)->Render(
      view, tiles,
      [&](size_t i, RenderedTile result, Renderer::Progress) { run.tiles[i] = std::move(result.pixels); },
      stop.get_token());
  alarm.request_stop();
  run.ended = status.has_value() || status.error().kind != ErrorKind::kCancelled;
  INFO((status ? "" : status.error().message));
  CHECK(run.ended == status.has_value());
  run.loads = (*renderer)->counters().cache.loaded;
  tasks.Stop();
  loading.join();
  return run;
}

}  // namespace quarry::test

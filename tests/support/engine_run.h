#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <optional>
#include <random>
#include <thread>
#include <utility>
#include <vector>

#include "common/engine/engine.h"
#include "common/engine/loader.h"
#include "common/voxel/store_reader.h"

namespace quarry::test {

/// What one frame came to.
struct EngineRun {
  bool ended = false;  ///< within the time allowed
  uint64_t loads = 0;
  std::vector<Bytes> tiles;  ///< pixels, by tile
};

/// A store's blocks, each at once or later, in an order drawn by lot. Used from the loader's thread.
class ShuffledSource final : public VoxelSource {
 public:
  ShuffledSource(const StoreReader& store, uint32_t seed) : store_(store), random_(seed) {}
  void Fetch(uint32_t block, Done done) override {
    if (random_() % 4 == 0) return done(store_.ReadBlock(block));
    waiting_.emplace_back(block, std::move(done));
  }
  /// Answers one of those that wait. False when there is none.
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
  std::vector<std::pair<uint32_t, Done>> waiting_;
};

/// Renders the frame as a worker does, with a cache of `cache_bytes` and so many threads, from a cold cache.
inline EngineRun RunEngine(const StoreReader& store, const RenderJob& job, uint64_t cache_bytes,
                           unsigned threads, std::chrono::seconds most) {
  const Catalog& catalog = store.catalog();
  const uint32_t across = (job.width + kTileSize - 1) / kTileSize,
                 down = (job.height + kTileSize - 1) / kTileSize;
  EngineRun run;
  run.tiles.resize(across * down);
  std::mutex mutex;
  std::condition_variable changed;
  bool scheduled = false, stop = false;
  uint32_t left = across * down;
  std::optional<Error> error;
  const auto wake = [&] {
    {
      const std::lock_guard lock(mutex);
      scheduled = true;
    }
    changed.notify_all();
  };
  VoxelCache cache(catalog, cache_bytes, wake, wake);
  ShuffledSource source(store, threads);
  Loader loader(catalog, cache, source, [&](const Error& e) { error = e; });
  std::thread loading([&] {
    for (;;) {
      {
        std::unique_lock lock(mutex);
        changed.wait(lock, [&] { return scheduled || stop; });
        if (stop) return;
        scheduled = false;
      }
      loader.Run();
      while (source.Answer()) {
      }
    }
  });
  {
    Engine engine(catalog, cache, threads, [&](const TileDone& done, Bytes pixels) {
      const std::lock_guard lock(mutex);
      run.tiles[done.tile] = std::move(pixels);
      if (--left == 0) changed.notify_all();
    });
    engine.SetFrame({1, job, 0});
    for (uint32_t t = 0; t < across * down; ++t) {
      TileOrder order;
      order.setup = 1;
      order.tile = t;
      order.x = t % across * kTileSize;
      order.y = t / across * kTileSize;
      order.width = std::min(kTileSize, job.width - order.x);
      order.height = std::min(kTileSize, job.height - order.y);
      engine.AddTile(order);
    }
    std::unique_lock lock(mutex);
    run.ended = changed.wait_for(lock, most, [&] { return left == 0; });
    stop = true;
    changed.notify_all();
  }
  loading.join();
  INFO((error ? error->message : ""));
  CHECK_FALSE(error.has_value());
  run.loads = cache.counters().loaded;
  return run;
}

}  // namespace quarry::test

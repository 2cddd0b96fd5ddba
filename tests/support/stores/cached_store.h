#pragma once

#include <fmt/format.h>

#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"
#include "worker/sources/disk_cache.h"

namespace quarry::test {

inline constexpr uint64_t kPlenty = 1 << 30;  ///< budget, in bytes, of a cache that never evicts

/// A small store with its reader and the keys of its blocks.
struct CacheScene {
  explicit CacheScene(uint32_t voxels = 20, uint32_t seed = 1) {
    WriteSmallStore(folder.file("s"), voxels, seed);
    auto opened = StoreReader::Open(folder.file("s"));
    REQUIRE(opened.has_value());
    store.emplace(std::move(*opened));
    blocks = BlocksOf(catalog());
  }
  const Catalog& catalog() const { return store->catalog(); }
  const SceneId& id() const { return catalog().id; }

  TemporaryFolder folder;
  std::optional<StoreReader> store;
  std::vector<BlockKey> blocks;
};

/// A source of the store's blocks that counts fetches. With `fault` it answers with an error, with `wrong`
/// with bytes that are not the block's.
struct CountingSource final : VoxelSource {
  explicit CountingSource(const StoreReader& s) : store(s) {}
  void Fetch(BlockKey block, Done done) override {
    ++fetched;
    if (fault) return done(Fail("the test's fault"));
    if (wrong) return done(Bytes(store.catalog().block(block).stored));
    done(store.ReadBlock(block));
  }
  const StoreReader& store;
  uint64_t fetched = 0;
  bool fault = false, wrong = false;
};

/// A disk-cached source over `folder`, with its log.
struct Cached {
  Cached(const CacheScene& s, const std::string& folder, uint64_t budget = kPlenty)
      : scene(s),
        inner(*s.store),
        source(std::in_place, io, inner, DiskCacheLocation{folder, budget}, s.catalog(),
               [this](const std::string& line) { log.push_back(line); }) {}

  Result<Bytes> Fetch(BlockKey block) {
    std::optional<Result<Bytes>> got;
    const auto here = std::this_thread::get_id();
    source->Fetch(block, [&](Result<Bytes> bytes) {
      CHECK(std::this_thread::get_id() == here);
      REQUIRE(!got);
      got = std::move(bytes);
    });
    io.restart();
    io.run();
    REQUIRE(got);
    return std::move(*got);
  }

  /// Fetches all blocks one after the other and checks their bytes.
  void FetchAll() {
    for (const BlockKey block : scene.blocks) {
      const auto got = Fetch(block);
      REQUIRE(got.has_value());
      REQUIRE(*got == scene.store->ReadBlock(block).value());
    }
  }

  /// The counters of the cache after all queued writes.
  DiskCachedSource::Counters End() {
    source->Close();
    return source->counters();
  }

  const CacheScene& scene;
  boost::asio::io_context io;
  CountingSource inner;
  std::vector<std::string> log;
  std::optional<DiskCachedSource> source;
};

/// The path of a cached block.
inline std::string PathOf(const CacheScene& scene, const std::string& folder, BlockKey block) {
  return fmt::format("{}/{}/{}", folder, FormatSceneId(scene.id()), scene.catalog().NumberOf(block));
}

/// The number of blocks in the folder over all scenes, and their bytes in whole blocks of the disk.
struct Held {
  uint64_t files = 0, bytes = 0, writers = 0, other = 0;
};
inline Held HeldBy(const std::string& folder) {
  Held held;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    const std::string name = entry.path().filename().string(),
                      parent = entry.path().parent_path().filename().string();
    if (name.starts_with("writer-") && entry.is_directory()) ++held.writers;
    if (!entry.is_regular_file() || name.ends_with(".lock")) continue;
    if (parent.size() == 32) {
      ++held.files;
      held.bytes += (entry.file_size() + 4095) / 4096 * 4096;
    } else {
      ++held.other;
    }
  }
  return held;
}

}  // namespace quarry::test

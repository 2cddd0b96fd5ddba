#pragma once

#include <boost/asio/io_context.hpp>
#include <catch2/catch.hpp>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"
#include "worker/sources/http_source.h"

namespace quarry::test {

/// The parsed URL. Requires: it is valid.
inline HttpLocation Location(const std::string& url) {
  auto location = ParseHttpLocation(url, "the address");
  REQUIRE(location.has_value());
  return *location;
}

/// A store on disk, with its bytes for test servers.
struct ServedScene {
  explicit ServedScene(uint32_t voxels = 8, uint32_t seed = 1) {
    WriteSmallStore(path, voxels, seed);
    auto opened = StoreReader::Open(path);
    REQUIRE(opened.has_value());
    store.emplace(std::move(*opened));
    const std::vector<char> file = ReadFile(path);
    bytes.assign(file.begin(), file.end());
  }
  const Catalog& catalog() const { return store->catalog(); }

  TemporaryFolder folder;
  std::string path = folder.file("scene.quarry");
  std::optional<StoreReader> store;
  std::string bytes;
};

/// Options with all time limits at `seconds`. Short limits let tests of silent servers end soon.
inline HttpOptions Patient(double seconds = 60) {
  HttpOptions options;
  options.connect_s = options.first_byte_s = options.stall_s = seconds;
  return options;
}

/// Requests all `blocks` at once and runs `io` until each is answered.
inline std::vector<Result<Bytes>> FetchAll(boost::asio::io_context& io, VoxelSource& source,
                                           const std::vector<BlockKey>& blocks) {
  std::vector<std::optional<Result<Bytes>>> got(blocks.size());
  for (size_t i = 0; i < blocks.size(); ++i)
    source.Fetch(blocks[i], [&got, i](Result<Bytes> bytes) {
      REQUIRE(!got[i]);
      got[i] = std::move(bytes);
    });
  io.restart();
  io.run();
  std::vector<Result<Bytes>> results;
  for (auto& g : got) {
    REQUIRE(g);
    results.push_back(std::move(*g));
  }
  return results;
}

/// Fetches a block and runs `io` until it is answered.
inline Result<Bytes> FetchOne(boost::asio::io_context& io, VoxelSource& source, BlockKey block) {
  return FetchAll(io, source, {block})[0];
}

/// Checks that every block from `source` equals the reader's.
inline void CheckAllBlocks(boost::asio::io_context& io, VoxelSource& source, const StoreReader& store) {
  const auto blocks = BlocksOf(store.catalog());
  REQUIRE(!blocks.empty());
  const auto got = FetchAll(io, source, blocks);
  for (size_t i = 0; i < blocks.size(); ++i) {
    INFO("block " << store.catalog().NumberOf(blocks[i]) << (got[i] ? "" : ": " + got[i].error().message));
    REQUIRE(got[i].has_value());
    REQUIRE(*got[i] == store.ReadBlock(blocks[i]).value());
  }
}

}  // namespace quarry::test

#include "common/engine/blocks/page_slabs.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <fstream>
#include <random>
#include <string>

namespace quarry {
namespace {

size_t Mappings() {
  std::ifstream maps("/proc/self/maps");
  size_t lines = 0;
  for (std::string line; std::getline(maps, line);) ++lines;
  return lines;
}

/// Whether every byte of a buffer is `value`.
bool Holds(const PageBuffer& buffer, int value) {
  for (const std::byte b : buffer.bytes())
    if (b != static_cast<std::byte>(value)) return false;
  return true;
}

}  // namespace

TEST_CASE("Small buffers of mixed sizes come from few mappings, and none overlap", "[slabs][long]") {
  PageSlabs slabs;
  PageBuffer none;
  std::mt19937 random(1);
  struct Used {
    PageBuffer buffer;
    int value;
  };
  std::vector<Used> used;
  const size_t before = Mappings();
  constexpr size_t kSizes[] = {4096, 12288, 16384, 100, 43688, 65536};
  for (int n = 0; n < 60000; ++n) {
    if (used.size() == 4000) {
      const size_t gone = random() % used.size();
      if (!Holds(used[gone].buffer, used[gone].value)) FAIL("buffer overwritten");
      std::swap(used[gone], used.back());
      used.pop_back();
    }
    auto buffer = slabs.Take(kSizes[random() % 6], none);
    REQUIRE(buffer.has_value());
    const int value = static_cast<int>(random() % 256);
    std::memset(buffer->bytes().data(), value, buffer->bytes().size());
    used.push_back({std::move(*buffer), value});
  }
  CHECK(slabs.slabs() < 4000 * 24 / 1024 + 100);  // 24 KiB in the mean
  CHECK(Mappings() < before + slabs.slabs() + 50);
  used.clear();
  CHECK(slabs.slabs() == 0);
  CHECK(Mappings() <= before + 50);
}

TEST_CASE("Slabs use memory that is mapped already, and units change their size within their pages",
          "[slabs]") {
  PageSlabs slabs;
  PageBuffer first = *PageBuffer::TryGet(2 * PageSlabs::kSlabBytes + 4096);
  const std::byte* const begin = first.bytes().data();
  auto buffer = slabs.Take(5000, first);
  REQUIRE(buffer.has_value());
  CHECK(buffer->is_unit());
  CHECK(buffer->bytes().size() == 5000);
  CHECK(buffer->bytes().data() == begin);
  CHECK(first.bytes().size() == PageSlabs::kSlabBytes + 4096);
  CHECK(buffer->Resize(8000));
  CHECK_FALSE(buffer->Resize(8193));
  CHECK(buffer->bytes().size() == 8000);
  CHECK(buffer->bytes().data() == begin);
}

}  // namespace quarry

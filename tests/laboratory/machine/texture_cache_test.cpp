#include "tests/laboratory/machine/texture_cache.h"

#include <catch2/catch.hpp>

#include "tests/laboratory/machine/counting_memory.h"

namespace quarry::laboratory {
namespace {

TextureCache Make(uint64_t bytes, uint32_t line, uint32_t ways) {
  auto cache = TextureCache::Create({bytes, line, ways});
  REQUIRE(cache);
  return std::move(*cache);
}

TEST_CASE("A cache has as many sets as fit its size", "[laboratory]") {
  // Purcell's: 65536 / 48 = 1365.3.
  const auto standard = TextureCache::Create();
  REQUIRE(standard);
  CHECK(standard->sets() == 1365);
  CHECK(Make(65536, 48, 2).sets() == 682);  // 65536 / 96 = 682.7
  CHECK(Make(65536, 64, 4).sets() == 256);
  CHECK(Make(48, 48, 1).sets() == 1);
  CHECK(Make(95, 48, 1).sets() == 1);
  CHECK(Make(65536, 4, 1).sets() == 16384);
  CHECK(Make(65536, 7, 3).sets() == 3120);  // 65536 / 21 = 3120.8
}

TEST_CASE("A bad shape of a cache is refused with a sentence", "[laboratory]") {
  const auto message = [](const TextureCacheOptions& options) {
    const auto cache = TextureCache::Create(options);
    return cache ? std::string() : cache.error().message;
  };
  CHECK(message({65536, 3, 1}) == "A line of a texture cache has 4 bytes or more, not 3.");
  CHECK(message({65536, 48, 0}) == "A texture cache has 1 way or more, not 0.");
  CHECK(message({47, 48, 1}) == "A texture cache of 47 bytes is too small for one set of 1 x 48 bytes.");
  CHECK(message({95, 48, 2}) == "A texture cache of 95 bytes is too small for one set of 2 x 48 bytes.");
  CHECK(message({uint64_t{1} << 40, 48, 1}) ==
        "A texture cache has at most 268435456 bytes, not 1099511627776.");
  // line * ways is beyond 32 bits.
  CHECK(message({65536, 0x80000000u, 2}) ==
        "A texture cache of 65536 bytes is too small for one set of 2 x 2147483648 bytes.");
}

TEST_CASE("A direct-mapped cache of 48-byte lines", "[laboratory]") {
  TextureCache cache = Make(65536, 48, 1);  // 1365 sets; the last is 1364, bytes 65472 to 65519
  CHECK(cache.Access(0, 12) == 1);          // line 0, set 0: the first time
  CHECK(cache.Access(12, 12) == 0);         // line 0
  CHECK(cache.Access(44, 4) == 0);          // line 0, its last word
  CHECK(cache.Access(48, 4) == 1);          // line 1
  CHECK(cache.Access(40, 16) == 0);         // lines 0 and 1: both there
  CHECK(cache.totals() == CacheTotals{5, 4, 2});
  // Line 1365 = byte 65520 is in set 0 as well: a conflict, and again on the way back.
  CHECK(cache.Access(65520, 4) == 1);
  CHECK(cache.Access(0, 4) == 1);
  CHECK(cache.Access(65520, 4) == 1);
  CHECK(cache.Access(48, 4) == 0);  // line 1 was not touched
  // The last set: line 1364, whose next byte is line 1365's, which is there.
  CHECK(cache.Access(65472, 4) == 1);
  CHECK(cache.Access(65516, 8) == 0);
  // Accesses 5 + 6; of these six: 1 + 1 + 1 + 1 misses and 1 + 2 hits.
  CHECK(cache.totals() == CacheTotals{11, 7, 6});
  CHECK(cache.fetched_bytes() == 6 * 48);
}

TEST_CASE("An access fetches each line that it spans", "[laboratory]") {
  TextureCache cache = Make(65536, 48, 1);
  CHECK(cache.Access(47, 2) == 2);    // lines 0 and 1
  CHECK(cache.Access(0, 96) == 0);    // both there
  CHECK(cache.Access(90, 60) == 2);   // lines 1 (there), 2 and 3: bytes 90 to 149
  CHECK(cache.Access(500, 0) == 0);   // nothing
  CHECK(cache.Access(192, 48) == 1);  // line 4 alone
  CHECK(cache.totals() == CacheTotals{4, 3, 5});
  // One line for the whole cache: each access in another line drops the last.
  TextureCache one = Make(48, 48, 1);
  CHECK(one.Access(0, 96) == 2);
  CHECK(one.Access(0, 96) == 2);   // line 0 has left for line 1, and so on
  CHECK(one.Access(48, 48) == 0);  // line 1 was the last
}

TEST_CASE("The least recently used line of a set is evicted", "[laboratory]") {
  TextureCache cache = Make(384, 48, 2);  // 384 / 96 = 4 sets; lines 0, 4, 8, 12 are in set 0
  const auto line = [](uint64_t number) { return number * 48; };
  CHECK(cache.Access(line(0), 4) == 1);  // {0}
  CHECK(cache.Access(line(4), 4) == 1);  // {4, 0}
  CHECK(cache.Access(line(0), 4) == 0);  // {0, 4}
  CHECK(cache.Access(line(8), 4) == 1);  // {8, 0}: 4 was the oldest
  CHECK(cache.Access(line(0), 4) == 0);  // {0, 8}
  CHECK(cache.Access(line(4), 4) == 1);  // {4, 0}: 8 leaves
  CHECK(cache.Access(line(8), 4) == 1);  // {8, 4}: 0 leaves
  CHECK(cache.Access(line(1), 4) == 1);  // set 1
  CHECK(cache.Access(line(4), 4) == 0);  // {4, 8}
  CHECK(cache.Access(line(0), 4) == 1);  // {0, 4}
  CHECK(cache.Access(line(8), 4) == 1);  // {8, 0}
  CHECK(cache.totals() == CacheTotals{11, 3, 8});
}

TEST_CASE("Accesses are counted by kind", "[laboratory]") {
  TextureCache cache = Make(65536, 48, 1);
  cache.Access(DataKind::kTriangles, 0, 96);
  cache.Access(DataKind::kTriangles, 0, 4);
  cache.Access(DataKind::kCells, 4, 4);
  cache.Access(4800, 4);
  CHECK(cache.totals(DataKind::kTriangles) == CacheTotals{2, 1, 2});
  CHECK(cache.totals(DataKind::kCells) == CacheTotals{1, 1, 0});
  CHECK(cache.totals(DataKind::kLists) == CacheTotals{});
  CHECK(cache.totals() == CacheTotals{4, 2, 3});
  CHECK(cache.fetched_bytes(DataKind::kTriangles) == 96);
}

TEST_CASE("Dropped lines are missed", "[laboratory]") {
  for (const uint64_t end : {uint64_t{100}, uint64_t{1} << 40}) {  // line by line, and in one sweep
    TextureCache cache = Make(384, 48, 2);
    cache.Access(0, 4 * 48);  // lines 0 to 3
    cache.Access(4 * 48, 4);  // line 4, beside line 0
    cache.Invalidate(50, end);
    CAPTURE(end);
    CHECK(cache.Access(0, 4) == 0);
    CHECK(cache.Access(48, 4) == 1);
    CHECK(cache.Access(96, 4) == 1);
    CHECK(cache.Access(144, 4) == (end == 100 ? 0 : 1));  // byte 100 is in line 2
    CHECK(cache.Access(192, 4) == (end == 100 ? 0 : 1));
    cache.Invalidate(192, 192);
    CHECK(cache.Access(192, 4) == 0);
    cache.Clear();
    CHECK(cache.Access(0, 8) == 1);
  }
}

struct Vector4 {
  float x, y, z, w;
};

TEST_CASE("Words are counted by kernel and kind", "[laboratory]") {
  AddressSpace space;
  const std::vector<uint32_t> cell_data{7, 8, 9};
  const std::vector<Vector4> vertex_data(2);
  std::vector<Vector4> ray_data(3);
  std::vector<uint8_t> state_data{1, 2, 3};
  const auto cells = space.TextureOf(cell_data, DataKind::kCells);
  const auto vertices = space.TextureOf(vertex_data, DataKind::kTriangles);
  const auto rays = space.StreamOf(ray_data);
  const auto states = space.StreamOf(state_data, DataKind::kStencil);
  CountingMemory memory;
  memory.SetKernel(2);
  CHECK(memory.Fetch(cells, 1) == 8);
  memory.Fetch(vertices, 0);
  memory.Store(rays, 2, Vector4{1, 2, 3, 4});
  memory.SetKernel(15);
  CHECK(memory.Load(states, 1) == 2);
  CHECK(memory.Load(rays, 2).y == 2);
  memory.Store(states, 0, uint8_t{9});
  memory.Fetch(cells, 0);
  CHECK(state_data[0] == 9);
  CHECK(memory.OfKernel(2) == MemoryWords{0, 4, 5});
  CHECK(memory.OfKernel(15) == MemoryWords{4, 0, 1});
  CHECK(memory.OfKernel(0) == MemoryWords{});
  CHECK(memory.OfKind(DataKind::kCells) == MemoryWords{0, 0, 2});
  CHECK(memory.OfKind(DataKind::kState) == MemoryWords{4, 4, 0});
  CHECK(memory.OfKind(DataKind::kStencil) == MemoryWords{});
  CHECK(memory.Of(2, DataKind::kTriangles) == MemoryWords{0, 0, 4});
  CHECK(memory.Total() == MemoryWords{4, 4, 6});
  CHECK(memory.StencilOfKernel(15) == StencilBytes{1, 1});
  CHECK(memory.StencilOfKernel(2) == StencilBytes{});
  CHECK(memory.Stencil() == StencilBytes{1, 1});
}

TEST_CASE("An element counts as the words that hold it", "[laboratory]") {
  AddressSpace space;
  std::vector<uint16_t> data(4);
  const auto stream = space.StreamOf(data);
  CountingMemory memory;
  memory.Store(stream, 3, uint16_t{1});
  memory.Load(stream, 3);
  CHECK(memory.OfKernel(0) == MemoryWords{1, 1, 0});
}

TEST_CASE("Reads of streams pass through the cache, writes invalidate its lines", "[laboratory]") {
  TextureCache cache = Make(65536, 64, 1);
  AddressSpace space;
  std::vector<Vector4> data(8);  // 16 bytes each: four in a line
  std::vector<uint8_t> state_data(8);
  const auto rays = space.StreamOf(data);  // at 4096, a line's beginning
  const auto states = space.StreamOf(state_data, DataKind::kStencil);
  CountingMemory memory(&cache);
  memory.SetKernel(0);
  for (size_t i = 0; i < 4; ++i) {  // in its pass the line that is read stays good
    memory.Load(rays, i);
    memory.Store(rays, i, Vector4{});
    memory.Load(states, i);
    memory.Store(states, i, uint8_t{1});
  }
  CHECK(cache.totals() == CacheTotals{4, 3, 1});  // nothing of the stencil
  memory.Store(rays, 4, Vector4{});               // no line for a store
  memory.Load(rays, 4);
  CHECK(cache.totals() == CacheTotals{5, 3, 2});
  memory.SetKernel(0);  // the next pass reads the stream that this pass wrote
  memory.Load(rays, 0);
  memory.Load(rays, 4);
  CHECK(cache.totals() == CacheTotals{7, 3, 4});
  memory.SetKernel(0);  // nothing was written
  memory.Load(rays, 0);
  CHECK(cache.totals() == CacheTotals{8, 4, 4});
  CHECK(cache.totals(DataKind::kState) == cache.totals());
}

}  // namespace
}  // namespace quarry::laboratory

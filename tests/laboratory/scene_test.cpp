// Scenes that the machine's memory cannot hold are refused before they are read.
#include "tests/laboratory/scene.h"

#include "common/base/size.h"
#include "tests/laboratory/made_scene.h"

namespace quarry::laboratory {
namespace {

constexpr uint64_t kTriangles = 1000000, kGiB = 1 << 30;

Catalog CatalogOf(uint64_t triangles) {
  Catalog catalog;
  catalog.meta.input_triangles = triangles;
  return catalog;
}
/// Bytes of a scene without attributes in a tree.
uint64_t SceneBytes() { return kTriangles * (LaboratoryScene::BytesPerTriangle(false) + kTreeBytes); }

std::string Refusal(const Status& status) {
  REQUIRE(!status.has_value());
  return status.error().message;
}

TEST_CASE("A store that fits to the last byte is loaded, and one byte less is refused") {
  const Catalog catalog = CatalogOf(kTriangles);
  const uint64_t scene = SceneBytes(), picture = kTriangles * 1000;
  REQUIRE(picture > scene);
  for (const auto& [needs, bytes] :
       {std::pair{MemoryNeeds{}, scene},
        {MemoryNeeds{.pixels = kTriangles, .bytes_per_pixel = 1000}, scene + picture},
        {MemoryNeeds{.twice = true}, 2 * scene},
        {MemoryNeeds{.cells = 1000}, scene + 8000},
        {MemoryNeeds{.pixels = kTriangles, .bytes_per_pixel = 1000, .twice = true}, scene + picture}}) {
    MemoryNeeds of = needs;
    of.structure_bytes = kTreeBytes;
    of.limit = bytes;
    CHECK(CheckMemory("x.quarry", catalog, of).has_value());
    of.limit = bytes - 1;
    CHECK(!CheckMemory("x.quarry", catalog, of).has_value());
  }
}

TEST_CASE("A refusal names the store, the memory needed, the memory there is, and the remedy") {
  const std::string scene = Refusal(
      CheckMemory("x.quarry", CatalogOf(10 * kTriangles), {.structure_bytes = kTreeBytes, .limit = kGiB}));
  CHECK(scene == "x.quarry: 10000000 triangles take about " + FormatSize(10 * SceneBytes()) +
                     " of memory, and there is 1.00 GiB: take a smaller model");
  const std::string picture = Refusal(
      CheckMemory("x.quarry", CatalogOf(0), {.pixels = 1 << 24, .bytes_per_pixel = 512, .limit = kGiB}));
  CHECK(picture ==
        "x.quarry: 0 triangles and a picture of 16777216 pixels take about 8.00 GiB of memory, and "
        "there is 1.00 GiB: take a smaller model or a smaller --size");
  const std::string twice =
      Refusal(CheckMemory("x.quarry", CatalogOf(10 * kTriangles), {.twice = true, .limit = kGiB}));
  CHECK(twice.ends_with("take a smaller model, or --no-instructions and --no-check, which need it once"));
  // No number overflows, and ids have 32 bits.
  CHECK(Refusal(CheckMemory("x.quarry", CatalogOf(0), {.pixels = ~0ull, .bytes_per_pixel = ~0ull}))
            .starts_with("x.quarry: 0 triangles and a picture of 18446744073709551615 pixels"));
  CHECK(Refusal(CheckMemory("x.quarry", CatalogOf(1ull << 32), {.limit = ~0ull})) ==
        "x.quarry: damaged: it claims 4294967296 triangles");
}

TEST_CASE("A store is loaded where it fits, and refused where it does not") {
  test::TemporaryFolder folder;
  MadeScene scene(GlassModel(folder));
  CHECK(LaboratoryScene::Load(scene.store(), {.limit = kGiB}).has_value());
  const auto refused = LaboratoryScene::Load(scene.store(), {.limit = 4096});
  REQUIRE(!refused.has_value());
  CHECK(refused.error().message.starts_with(scene.store() + ": "));
  CHECK(refused.error().message.ends_with("there is 4.00 KiB: take a smaller model"));
  CHECK(refused.error().exit_status() == 1);
}

}  // namespace
}  // namespace quarry::laboratory

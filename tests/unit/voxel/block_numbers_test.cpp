#include <catch2/catch.hpp>
#include <optional>
#include <vector>

#include "tests/support/stores/voxel_blocks.h"

namespace quarry {
namespace {

void AddTexture(Catalog& catalog, uint32_t width, uint32_t height) {
  const TextureShape shape(width, height);
  catalog.textures.push_back({"t", {width, height, 3, TexelFormat::kSrgb8}, {}});
  catalog.textures.back().pages.resize(shape.pages(), {0, 100, 100, 0});
  catalog.shapes.push_back(shape);
  catalog.first_page.push_back(catalog.first_page.back() + shape.pages());
}

}  // namespace

TEST_CASE("A block's number is the same in messages and files, and gives the block back", "[store]") {
  Catalog catalog = test::CatalogOf(3, 100);
  catalog.voxels[1].blocks[1] = {};  // has no attributes
  AddTexture(catalog, 256, 256);     // 16, 4 and 1 pages
  AddTexture(catalog, 1, 1);         // one page
  AddTexture(catalog, 128, 64);      // 2 and 1 pages
  CHECK(catalog.NumberOf(BlockKey::Hot(0)) == 0);
  CHECK(catalog.NumberOf(BlockKey::Shading(0)) == 1);
  CHECK(catalog.NumberOf(BlockKey::Shading(2)) == 5);
  CHECK(catalog.NumberOf(catalog.PageKey(0, 0)) == 6);
  CHECK(catalog.NumberOf(catalog.PageKey(0, 20)) == 26);
  CHECK(catalog.NumberOf(catalog.PageKey(1, 0)) == 27);
  CHECK(catalog.NumberOf(catalog.PageKey(2, 2)) == 30);
  REQUIRE(catalog.block_numbers() == 31);

  std::vector<BlockKey> keys;
  std::vector<uint32_t> numbers;
  for (uint32_t number = 0; number < 31; ++number) {
    INFO(number);
    const std::optional<BlockKey> block = catalog.BlockOf(number);
    CHECK(block.has_value() == (number != 3));
    if (!block) continue;
    CHECK(catalog.NumberOf(*block) == number);
    if (block->kind() == BlockKind::kPage)
      CHECK(catalog.PageKey(catalog.TextureOf(*block), catalog.PageOf(*block)) == *block);
    if (!keys.empty()) CHECK(keys.back() < *block);
    keys.push_back(*block);
    numbers.push_back(number);
  }
  CHECK(catalog.NumbersOf(keys) == numbers);
  for (const uint32_t number : {31u, 32u, 1u << 31, ~0u}) CHECK_FALSE(catalog.BlockOf(number));
  CHECK_FALSE(Catalog().BlockOf(0));
}

TEST_CASE("A key gives back its kind and index, to the last voxel and page", "[store]") {
  const uint32_t indices[] = {0, 1, 0x0FFFFFFF, 0x7FFFFFFF, ~0u};
  for (const BlockKind kind : {BlockKind::kHot, BlockKind::kShading, BlockKind::kPage})
    for (const uint32_t index : indices) {
      const BlockKey key(kind, index);
      CHECK(key.kind() == kind);
      CHECK(key.index() == index);
      CHECK(key.bits() >> BlockKey::kBits == 0);
    }
  CHECK(BlockKey::Hot(0) < BlockKey::Shading(0));
  CHECK(BlockKey::Shading(0) < BlockKey::Hot(1));
  CHECK(BlockKey::Shading(~0u) < BlockKey::Page(0));
}

}  // namespace quarry

#include "common/engine/blocks/touched_blocks.h"

#include <catch2/catch.hpp>

namespace quarry {

TEST_CASE("A tile reports each block once, and the first that it met of too many") {
  TouchedBlocks touched;
  const auto meet = [&](uint32_t voxel) {
    touched.log().push_back(BlockKey::Hot(voxel));
    touched.Tidy();
  };
  for (const uint32_t voxel : {5u, 3u, 5u, 9u}) meet(voxel);
  CHECK(touched.Take() == std::vector{BlockKey::Hot(3), BlockKey::Hot(5), BlockKey::Hot(9)});
  CHECK(touched.Take().empty());
  // Descending, each several times: the last ones are left out.
  for (uint32_t voxel = 20000; voxel > 0; --voxel)
    for (int again = 0; again < 3; ++again) meet(voxel);
  const auto blocks = touched.Take();
  REQUIRE(blocks.size() == TouchedBlocks::kMost);
  CHECK(blocks.front() == BlockKey::Hot(20001 - TouchedBlocks::kMost));
  CHECK(blocks.back() == BlockKey::Hot(20000));
}

}  // namespace quarry

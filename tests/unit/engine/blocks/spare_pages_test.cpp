#include "common/engine/blocks/spare_pages.h"

#include <catch2/catch.hpp>

namespace quarry {
namespace {

constexpr size_t kPage = 4096;

/// A buffer of pages, and its address.
const std::byte* Keep(SparePages& spare, size_t pages) {
  auto buffer = PageBuffer::TryGet(pages * kPage);
  REQUIRE(buffer);
  const std::byte* const begin = buffer->bytes().data();
  spare.Keep(std::move(*buffer));
  return begin;
}

}  // namespace

TEST_CASE("A block gets the spare pages that fit, as they are") {
  SparePages spare(100 * kPage);
  CHECK_FALSE(spare.Take(1, 0).has_value());
  Keep(spare, 3);
  const std::byte* const five = Keep(spare, 5);
  Keep(spare, 9);
  CHECK(spare.bytes() == 17 * kPage);
  const auto taken = spare.Take(4 * kPage + 1, 0);
  REQUIRE(taken);
  CHECK(taken->bytes().data() == five);
  CHECK(taken->bytes().size() == 4 * kPage + 1);
  CHECK(spare.bytes() == 12 * kPage);
  // Else the nearest is resized.
  auto grown = spare.Take(20 * kPage, 0);
  REQUIRE(grown);
  CHECK(grown->bytes().size() == 20 * kPage);
  for (std::byte& b : grown->bytes()) b = std::byte{1};
  CHECK(spare.bytes() == 3 * kPage);
}

TEST_CASE("Spare pages stay within their limit, but for the last") {
  SparePages spare(10 * kPage);
  Keep(spare, 6);
  const std::byte* const four = Keep(spare, 4);
  CHECK(spare.bytes() == 10 * kPage);
  Keep(spare, 1);
  CHECK(spare.bytes() == 5 * kPage);
  CHECK(spare.Take(4 * kPage, 0)->bytes().data() == four);
  Keep(spare, 30);
  CHECK(spare.bytes() == 30 * kPage);
  spare.Trim();
  CHECK(spare.bytes() == 0);
  Keep(spare, 2);
  spare.Clear();
  CHECK(spare.bytes() == 0);
  CHECK_FALSE(spare.Take(1, 0).has_value());
}

TEST_CASE("A block takes spare pages that are a few too many as they are") {
  SparePages spare(100 * kPage);
  Keep(spare, 16);
  const std::byte* const eighteen = Keep(spare, 18);
  Keep(spare, 19);
  auto taken = spare.Take(17 * kPage - 1, 2 * kPage);  // 16 pages lie as near, but are too few
  REQUIRE(taken);
  CHECK(taken->bytes().data() == eighteen);
  CHECK(taken->bytes().size() == 17 * kPage - 1);
  CHECK(taken->slack() == kPage);
  CHECK(spare.bytes() == 35 * kPage);
  // Its pages are kept again, all of them.
  spare.Keep(std::move(*taken));
  CHECK(spare.bytes() == 53 * kPage);
  CHECK(spare.Take(18 * kPage, 0)->bytes().data() == eighteen);
  // More pages than the slack allows are given back.
  const auto cut = spare.Take(10 * kPage, 5 * kPage);
  REQUIRE(cut);
  CHECK(cut->slack() == 0);
  CHECK(cut->mapped() == 10 * kPage);
}

}  // namespace quarry

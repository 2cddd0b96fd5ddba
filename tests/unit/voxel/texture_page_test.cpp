#include "common/voxel/texture_page.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

#include "common/math/half.h"
#include "common/voxel/texture_shape.h"
#include "common/voxel/voxel_block.h"

namespace quarry {
namespace {

/// Texels of a page: smooth with some noise, as images are.
Bytes MakeTexels(size_t bytes, uint32_t seed) {
  std::mt19937 random(seed);
  Bytes texels(bytes);
  for (size_t i = 0; i < bytes; ++i) texels[i] = static_cast<std::byte>(i / 7 + random() % 5);
  return texels;
}

}  // namespace

TEST_CASE("Levels halve down to one texel, and pages cover each level once", "[texture]") {
  for (const auto& [width, height] : {std::pair{1u, 1u},
                                      {64u, 64u},
                                      {65u, 1u},
                                      {1u, 200u},
                                      {129u, 67u},
                                      {1000u, 3u},
                                      {640u, 480u},
                                      {kMaxTextureSide, 2u}}) {
    CAPTURE(width, height);
    const TextureShape shape(width, height);
    CHECK(shape.levels().back().width == 1);
    CHECK(shape.levels().back().height == 1);
    uint64_t all = 0, covered = 0;
    for (size_t l = 0; l < shape.levels().size(); ++l) {
      const auto& level = shape.levels()[l];
      all += uint64_t{level.width} * level.height;
      if (l == 0) continue;
      CHECK(level.width == std::max(shape.levels()[l - 1].width / 2, 1u));
      CHECK(level.height == std::max(shape.levels()[l - 1].height / 2, 1u));
    }
    for (uint32_t p = 0; p < shape.pages(); ++p) {
      covered += shape.TexelsOf(p);
      const TextureShape::Part part = shape.PartOf(p);
      const auto& level = shape.levels()[part.level];
      CHECK(shape.PageOf(part.level, part.x / kPageSide, part.y / kPageSide) == p);
      CHECK((part.x + part.width <= level.width && part.y + part.height <= level.height));
    }
    CHECK(covered == all);
    CHECK(shape.levels()[shape.tail()].width <= kPageSide);
    CHECK(shape.levels()[shape.tail()].height <= kPageSide);
  }
}

TEST_CASE("Pages return every texel, of every format, number of channels and size", "[texture]") {
  for (const TexelFormat format : {TexelFormat::kSrgb8, TexelFormat::kLinear8, TexelFormat::kHalf}) {
    for (uint32_t channels = 1; channels <= 4; ++channels) {
      const TexelLayout layout{131, 70, channels, format};
      const TextureShape shape(layout.width, layout.height);
      for (uint32_t p = 0; p < shape.pages(); ++p) {
        const Bytes texels = MakeTexels(shape.TexelsOf(p) * layout.texel_bytes(), p);
        const Bytes streams = EncodePage(shape, layout, p, texels);
        CHECK(streams.size() == texels.size());
        const auto decoded = DecodePage(shape, layout, p, CompressBlock(streams));
        REQUIRE(decoded);
        REQUIRE(*decoded == texels);
      }
    }
  }
}

TEST_CASE("A page of one colour is tiny, and a page of noise is no larger than its texels", "[texture]") {
  const TexelLayout layout{64, 64, 3, TexelFormat::kSrgb8};
  const TextureShape shape(64, 64);
  const size_t bytes = shape.TexelsOf(0) * 3;
  CHECK(CompressBlock(EncodePage(shape, layout, 0, Bytes(bytes, std::byte{77}))).size() < 200);
  std::mt19937 random(1);
  Bytes noise(bytes);
  for (std::byte& b : noise) b = static_cast<std::byte>(random());
  const Bytes stored = CompressBlock(EncodePage(shape, layout, 0, noise));
  CHECK(stored.size() == bytes + 4);
  CHECK(DecodePage(shape, layout, 0, stored).value() == noise);
}

TEST_CASE("Damaged pages are refused or give the right number of texels, never more", "[texture]") {
  const TexelLayout layout{100, 90, 4, TexelFormat::kHalf};
  const TextureShape shape(layout.width, layout.height);
  const Bytes whole = CompressBlock(EncodePage(shape, layout, 0, MakeTexels(shape.TexelsOf(0) * 8, 1)));
  std::mt19937 random(5);
  int refused = 0;
  for (int i = 0; i < 3000; ++i) {
    Bytes bad = whole;
    for (int k = 0; k < 1 + i % 3; ++k) bad[random() % bad.size()] = static_cast<std::byte>(random());
    if (i % 4 == 0) bad.resize(random() % bad.size());
    const auto decoded = DecodePage(shape, layout, 0, bad);
    if (decoded) REQUIRE(decoded->size() == shape.TexelsOf(0) * 8);
    refused += !decoded;
    if (!decoded) REQUIRE(decoded.error().message.find("texture page: ") == 0);
  }
  CHECK(refused > 1000);
  CHECK_FALSE(DecodePage(shape, layout, 0, {}));
}

TEST_CASE("Halves: all of them are restored, and floats become the nearest", "[texture]") {
  for (uint32_t bits = 0; bits < 65536; ++bits) {
    const float value = HalfToFloat(static_cast<uint16_t>(bits));
    if (!std::isfinite(value)) continue;
    REQUIRE(FloatToHalf(value) == bits);
    // Halfway to the next: to the even one.
    const float next = HalfToFloat(static_cast<uint16_t>(bits + 1));
    if (!std::isfinite(next) || bits == 0x7FFF) continue;
    const float middle = static_cast<float>((static_cast<double>(value) + next) / 2);
    REQUIRE(FloatToHalf(middle) == (bits % 2 == 0 ? bits : bits + 1));
    REQUIRE(FloatToHalf(std::nextafter(middle, next)) == bits + 1);
    REQUIRE(FloatToHalf(std::nextafter(middle, value)) == bits);
  }
  CHECK(HalfToFloat(FloatToHalf(1e30f)) == kLargestHalf);
  CHECK(HalfToFloat(FloatToHalf(-std::numeric_limits<float>::infinity())) == -kLargestHalf);
  CHECK(FloatToHalf(std::numeric_limits<float>::quiet_NaN()) == 0);
  CHECK(FloatToHalf(0.3f) == 0x34CD);
}

}  // namespace quarry

#include "preprocess/texture/mip_builder.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <functional>
#include <map>
#include <random>

#include "common/math/elementary.h"
#include "common/math/half.h"
#include "preprocess/texture/row_converter.h"
#include "preprocess/texture/texel_codes.h"

namespace quarry {
namespace {

/// All levels of a texture, put together from its pages.
struct Levels {
  TexelLayout layout;
  TextureShape shape;
  std::vector<Bytes> texels;

  const std::byte* At(uint32_t level, uint32_t x, uint32_t y) const {
    return &texels[level][(size_t{y} * shape.levels()[level].width + x) * layout.texel_bytes()];
  }
  int Byte(uint32_t level, uint32_t x, uint32_t y, uint32_t c = 0) const {
    return static_cast<int>(At(level, x, y)[c]);
  }
};

using Texel = std::function<void(uint32_t x, uint32_t y, std::byte* out)>;

Levels Build(const TexelLayout& layout, const Texel& texel) {
  Levels all{layout, TextureShape(layout.width, layout.height), {}};
  for (const auto& level : all.shape.levels())
    all.texels.emplace_back(size_t{level.width} * level.height * layout.texel_bytes());
  std::map<uint32_t, int> emitted;
  MipBuilder builder(layout, [&](uint32_t page, std::span<const std::byte> texels) -> Status {
    ++emitted[page];
    REQUIRE(texels.size() == all.shape.TexelsOf(page) * layout.texel_bytes());
    const TextureShape::Part part = all.shape.PartOf(page);
    if (page + 1 == all.shape.pages()) {
      for (uint32_t l = part.level; l < all.texels.size(); ++l)
        std::memcpy(all.texels[l].data(), &texels[all.shape.TailOffset(l) * layout.texel_bytes()],
                    all.texels[l].size());
      return {};
    }
    const size_t bytes = part.width * layout.texel_bytes();
    for (uint32_t y = 0; y < part.height; ++y)
      std::memcpy(const_cast<std::byte*>(all.At(part.level, part.x, part.y + y)), &texels[y * bytes], bytes);
    return {};
  });
  Bytes row(size_t{layout.width} * layout.texel_bytes());
  for (uint32_t y = 0; y < layout.height; ++y) {
    for (uint32_t x = 0; x < layout.width; ++x) texel(x, y, &row[size_t{x} * layout.texel_bytes()]);
    REQUIRE(builder.AddRow(row));
  }
  CHECK(emitted.size() == all.shape.pages());
  for (const auto& [page, times] : emitted) CHECK(times == 1);
  return all;
}

std::byte B(int value) { return static_cast<std::byte>(value); }

}  // namespace

TEST_CASE("Mip levels: one colour stays what it is", "[texture]") {
  for (const auto& [width, height] : {std::pair{1u, 1u}, {200u, 131u}, {64u, 1u}, {7u, 300u}}) {
    for (const TexelFormat format : {TexelFormat::kSrgb8, TexelFormat::kLinear8}) {
      const Levels all = Build({width, height, 4, format}, [](uint32_t, uint32_t, std::byte* out) {
        const int rgba[] = {3, 140, 255, 99};
        for (int c = 0; c < 4; ++c) out[c] = B(rgba[c]);
      });
      for (uint32_t l = 0; l < all.texels.size(); ++l)
        for (size_t i = 0; i < all.texels[l].size(); ++i)
          REQUIRE(static_cast<int>(all.texels[l][i]) == (i % 4 == 0   ? 3
                                                         : i % 4 == 1 ? 140
                                                         : i % 4 == 2 ? 255
                                                                      : 99));
    }
  }
}

TEST_CASE("Mip levels: linear light is averaged", "[texture]") {
  const auto checkers = [](uint32_t x, uint32_t y, std::byte* out) { *out = B((x + y) % 2 ? 255 : 0); };
  const Levels color = Build({256, 128, 1, TexelFormat::kSrgb8}, checkers);
  const Levels number = Build({256, 128, 1, TexelFormat::kLinear8}, checkers);
  for (uint32_t l = 1; l < color.texels.size(); ++l) {
    CHECK(color.Byte(l, 0, 0) == 188);  // sRGB of a half
    CHECK(number.Byte(l, 0, 0) == 128);
  }
}

TEST_CASE("Mip levels: with odd sides every texel has the same weight", "[texture]") {
  for (const auto& [width, height] : {std::pair{5u, 7u}, {3u, 1u}, {1u, 9u}, {131u, 67u}, {255u, 127u}}) {
    CAPTURE(width, height);
    std::mt19937 random(width);
    double sum = 0;
    const Levels all = Build({width, height, 1, TexelFormat::kHalf}, [&](uint32_t, uint32_t, std::byte* out) {
      const uint16_t half = FloatToHalf(static_cast<float>(random() % 1000));
      sum += HalfToFloat(half);
      std::memcpy(out, &half, 2);
    });
    uint16_t last;
    std::memcpy(&last, all.texels.back().data(), 2);
    const double mean = sum / (width * height);
    CHECK(std::fabs(HalfToFloat(last) - mean) <= mean / 1024);
  }
  // 3 to 1: a third each. 5 to 2: (2, 2, 1) and (1, 2, 2) fifths.
  const Levels three = Build({3, 1, 1, TexelFormat::kLinear8},
                             [](uint32_t x, uint32_t, std::byte* out) { *out = B(x == 1 ? 30 : 60); });
  CHECK(three.Byte(1, 0, 0) == 50);
  const Levels five = Build({1, 5, 1, TexelFormat::kLinear8},
                            [](uint32_t, uint32_t y, std::byte* out) { *out = B(static_cast<int>(y) * 50); });
  CHECK(five.Byte(1, 0, 0) == (0 * 2 + 50 * 2 + 100) / 5);
  CHECK(five.Byte(1, 0, 1) == (100 + 150 * 2 + 200 * 2) / 5);
}

TEST_CASE("Mip levels: invisible texels contribute no colour", "[texture]") {
  const Levels all = Build({2, 2, 4, TexelFormat::kLinear8}, [](uint32_t x, uint32_t, std::byte* out) {
    out[0] = B(x == 0 ? 200 : 0);  // red, and nothing beside it that is green
    out[1] = B(x == 0 ? 0 : 255);
    out[2] = B(0);
    out[3] = B(x == 0 ? 255 : 0);
  });
  CHECK(all.Byte(1, 0, 0, 0) == 200);
  CHECK(all.Byte(1, 0, 0, 1) == 0);
  CHECK(all.Byte(1, 0, 0, 3) == 128);
}

TEST_CASE("Texels: every code of 8 bits is its own nearest", "[texture]") {
  for (int code = 0; code < 256; ++code) {
    REQUIRE(ToSrgbByte(static_cast<float>(DecodeSrgb(code / 255.0))) == B(code));
    REQUIRE(ToByte(static_cast<float>(code) / 255) == B(code));
    REQUIRE(std::fabs(EncodeSrgb(DecodeSrgb(code / 255.0)) * 255 - code) < 1e-4);
  }
  CHECK(ToSrgbByte(7) == B(255));
  CHECK(ToSrgbByte(-1) == B(0));
  CHECK(ToByte(std::nanf("")) == B(0));
}

TEST_CASE("Rows: the requested channels, as they are stored", "[texture]") {
  const ImageFacts rgba{2, 1, 4, 0, 0};
  const Bytes row = {B(10), B(20), B(30), B(40), B(50), B(60), B(70), B(80)};
  const auto picked = [&](const ImageFacts& facts, bool color, TexturePick pick, TexelLayout& layout) {
    RowConverter converter(facts, color, pick);
    layout = converter.layout();
    const auto texels = converter.Convert(std::span(row).first(facts.row_bytes()));
    return Bytes(texels.begin(), texels.end());
  };
  TexelLayout layout;
  CHECK(picked(rgba, true, TexturePick::kColor, layout) == Bytes{B(10), B(20), B(30), B(50), B(60), B(70)});
  CHECK(layout == TexelLayout{2, 1, 3, TexelFormat::kSrgb8});
  CHECK(picked(rgba, true, TexturePick::kColorAndAlpha, layout) == row);
  CHECK(layout.channels == 4);
  CHECK(picked(rgba, false, TexturePick::kScalar, layout) == Bytes{B(40), B(80)});
  CHECK(layout == TexelLayout{2, 1, 1, TexelFormat::kLinear8});
  CHECK(picked(rgba, false, TexturePick::kBlue, layout) == Bytes{B(30), B(70)});
  CHECK(picked(rgba, false, TexturePick::kLuminance, layout) == Bytes{B(19), B(59)});
  CHECK(picked({2, 1, 3, 0, 0}, false, TexturePick::kScalar, layout) == Bytes{B(19), B(49)});
  CHECK(picked({2, 1, 1, 0, 0}, true, TexturePick::kColorAndAlpha, layout) == Bytes{B(10), B(20)});

  // Deep whole numbers of colour are decoded; floats are light already.
  const float reals[2] = {0.5f, 100.0f};
  for (const uint32_t encoded : {1u, 0u}) {
    RowConverter converter({2, 1, 1, 1, encoded}, true, TexturePick::kColor);
    CHECK(converter.layout().format == TexelFormat::kHalf);
    uint16_t halves[2];
    std::memcpy(halves, converter.Convert(std::as_bytes(std::span(reals))).data(), 4);
    CHECK(HalfToFloat(halves[0]) == Approx(encoded ? 0.21404114 : 0.5).epsilon(0.001));
    CHECK(HalfToFloat(halves[1]) == (encoded ? 1.0f : 100.0f));
  }
}

}  // namespace quarry

#include "master/display/frame_encoder.h"

#include <catch2/catch.hpp>

#include "common/math/elementary.h"
#include "common/math/shared_exponent.h"
#include "master/pictures/shown_color.h"

// Pictures for viewers before they are compressed.

namespace quarry {

TEST_CASE(
    "A lattice becomes a picture with one pixel a square, and empty squares get their neighbours' colour",
    "[live]") {
  const uint32_t red = PackShared({1, 0, 0}), blue = PackShared({0, 0, 1}),
                 grey = PackShared({0.5f, 0.5f, 0.5f});
  const ToneTable tone(0);
  // Cut squares at both borders: 4 x 2 squares of 4 pixels.
  PictureRows rows{0, 14, std::vector<uint32_t>(14 * 6, kUntraced)};
  for (uint32_t x = 0; x < 14; x += 4)
    for (uint32_t y = 0; y < 6; y += 4) rows.codes[y * 14 + x] = x < 8 ? red : blue;
  rows.codes[0 * 14 + 13] = blue;     // a second pixel of a square
  rows.codes[4 * 14 + 4] = kWaiting;  // a hole
  RgbMaker maker;
  maker.MakeSmall(rows, tone, grey, 4);
  const auto& rgb = maker.rgb();
  REQUIRE(rgb.size() == 3 * 4 * 2);
  const auto pixel = [&](size_t i) {
    return std::array<uint8_t, 3>{rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]};
  };
  CHECK(pixel(0) == tone(red));
  CHECK(pixel(1) == tone(red));
  CHECK(pixel(2) == tone(blue));
  CHECK(pixel(3) == tone(blue));
  CHECK(pixel(4) == tone(red));
  CHECK(pixel(5)[0] > 128);  // between red neighbours, of which more are near than blue ones
  CHECK(pixel(6) == tone(blue));
  // Nothing traced: the background.
  maker.MakeSmall({0, 14, std::vector<uint32_t>(14 * 6, kWaiting)}, tone, grey, 4);
  for (size_t i = 0; i < 8; ++i) CHECK(pixel(i) == tone(grey));
}

TEST_CASE("The backdrop has the same colour at every exposure, mixed by coverage at edges", "[live]") {
  const uint32_t red = PackShared({0.5f, 0, 0});
  PictureRows rows{0, 3, {kUncovered, red, PackShared({0.25f, 0, 0})}, {0, 255, 128}};
  const std::array<uint8_t, 3> behind{232, 236, 241};
  for (const double ev : {-7.0, 0.0, 5.5}) {
    const ToneTable tone(ev);
    RgbMaker maker;
    maker.Make(rows, tone, kUncovered);
    for (size_t c = 0; c < 3; ++c) CHECK(maker.rgb()[c] == behind[c]);
    CHECK(maker.rgb()[3] == tone(red)[0]);
    CHECK(maker.rgb()[4] == 0);
    CHECK(maker.rgb()[7] == static_cast<uint8_t>(EncodeSrgb(kBackdrop[1] * 127 / 255) * 255 + 0.5));
  }
}

TEST_CASE("Film's curve leaves values up to a half, rises, and ends below white", "[live]") {
  for (const double x : {0.0, 0.1, 0.5}) CHECK(Toned(ToneCurve::kFilm, x) == x);
  double before = 0.5;
  for (double x = 0.51; x < 1e6; x *= 1.1) {
    const double shown = Toned(ToneCurve::kFilm, x);
    CHECK(shown > before);
    CHECK(shown < std::min(x, 1.0));
    before = shown;
  }
  CHECK(Toned(ToneCurve::kClip, 7.0) == 7);
  // A frame on its way shows the bytes of a PNG.
  const ToneTable film(1, ToneCurve::kFilm), clip(1);
  for (const float value : {0.125f, 0.25f, 0.5f, 2.0f, 8.0f}) {
    const uint32_t code = PackShared(glm::vec3(value));
    CHECK(film(code)[1] == ShownByte(value, 2, 1, 1, ToneCurve::kFilm));
    CHECK(clip(code)[1] == ShownByte(value, 2, 1, 1, ToneCurve::kClip));
  }
  CHECK(film(kUncovered) == clip(kUncovered));
  CHECK(film.Is(1, ToneCurve::kFilm));
  CHECK_FALSE(film.Is(1, ToneCurve::kClip));
}

}  // namespace quarry

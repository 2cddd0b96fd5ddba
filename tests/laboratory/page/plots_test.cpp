// Pictures that gnuplot draws, read back.
#include "tests/laboratory/page/plots.h"

#include <OpenImageIO/imageio.h>

#include <array>
#include <catch2/catch.hpp>

#include "tests/reference/scene_fixture.h"
#include "tests/support/skip.h"

namespace quarry::laboratory {

TEST_CASE("a picture is drawn the right way up, in its colours") {
  if (!GnuplotInstalled()) {
    test::Skip("gnuplot is not installed on this machine");
    return;
  }
  const test::TemporaryFolder folder;
  const std::string path = folder.file("picture.png");
  // Two by two: red and green above blue and white.
  const std::vector<float> pixels{1, 0, 0, 0, 1, 0, 0, 0, 1, 1, 1, 1};
  const Status drawn = DrawPicture(pixels, 2, "a \"title\" \\ of\ntwo lines", path);
  INFO((drawn ? "" : drawn.error().message));
  REQUIRE(drawn);
  const auto input = OIIO::ImageInput::open(path);
  REQUIRE(input);
  const OIIO::ImageSpec& spec = input->spec();
  std::vector<uint8_t> image(size_t{4} * static_cast<size_t>(spec.width) * static_cast<size_t>(spec.height));
  REQUIRE(input->read_image(0, 0, 0, 3, OIIO::TypeDesc::UINT8, image.data()));
  const auto at = [&](double x, double y) {
    const auto column = static_cast<size_t>(x * spec.width), row = static_cast<size_t>(y * spec.height);
    const uint8_t* p = &image[3 * (row * static_cast<size_t>(spec.width) + column)];
    return std::array<int, 3>{p[0], p[1], p[2]};
  };
  CHECK(at(0.3, 0.35) == std::array<int, 3>{255, 0, 0});
  CHECK(at(0.7, 0.35) == std::array<int, 3>{0, 255, 0});
  CHECK(at(0.3, 0.75) == std::array<int, 3>{0, 0, 255});
  CHECK(at(0.7, 0.75) == std::array<int, 3>{255, 255, 255});
}

TEST_CASE("a picture that cannot be drawn names its file") {
  if (!GnuplotInstalled()) {
    test::Skip("gnuplot is not installed on this machine");
    return;
  }
  const Status drawn = DrawStacked({"title", "unit", {"part"}, {{"column", {1}}}}, "/nowhere/figure.png");
  REQUIRE(!drawn);
  CHECK(drawn.error().message == "/nowhere/figure.png: gnuplot could not draw it");
}

}  // namespace quarry::laboratory

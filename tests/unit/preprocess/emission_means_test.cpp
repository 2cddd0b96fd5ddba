#include "preprocess/texture/emission_means.h"

#include <catch2/catch.hpp>
#include <optional>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// The file of a store under way, with one texture of 200 x 100 texels: black on the left, and on the right
/// red 255, green 188 of sRGB and no blue.
class MapFile {
 public:
  MapFile() {
    auto writer = StoreWriter::Continue(folder_.file("out"), folder_.file("part"), {});
    REQUIRE(writer);
    writer_.emplace(std::move(*writer));
    constexpr uint32_t kWidth = 200, kHeight = 100;
    const TexelLayout layout{kWidth, kHeight, 3, TexelFormat::kSrgb8};
    const TextureShape shape(kWidth, kHeight);
    writer_->BeginTexture("map", layout);
    for (uint32_t page = 0; page < shape.pages(); ++page) {
      Bytes texels;
      const auto put = [&](uint32_t x, uint32_t width) {
        const bool bright = 2 * x >= width;
        for (const int value : {bright ? 255 : 0, bright ? 188 : 0, 0})
          texels.push_back(static_cast<std::byte>(value));
      };
      const TextureShape::Part part = shape.PartOf(page);
      const bool is_tail = part.level == shape.tail();
      const size_t end = is_tail ? shape.levels().size() : part.level + 1;
      for (size_t l = part.level; l < end; ++l) {
        const TextureShape::Level& level = shape.levels()[l];
        const uint32_t width = is_tail ? level.width : part.width,
                       height = is_tail ? level.height : part.height;
        for (uint32_t i = 0; i < width * height; ++i) put((is_tail ? 0 : part.x) + i % width, level.width);
      }
      REQUIRE(writer_->AddPage(page, EncodeTexturePage(shape, layout, page, texels)));
    }
    lamp_.textures = {{TextureUse::kEmission, 0}};
    lamp_.textures[0].factor = glm::vec4(2, 2, 2, 1);
  }

  /// The mean over a triangle with a right angle at `corner`.
  glm::vec3 MeanAt(const glm::vec2& corner, float side) {
    Emitter emitter;
    for (int i = 0; i < 3; ++i) emitter.uvs[i] = corner + glm::vec2(i == 1 ? side : 0, i == 2 ? side : 0);
    REQUIRE(writer_->Flush());
    const auto file = InputFile::Open(folder_.file("part"));
    REQUIRE(file);
    EmissionMeans means(writer_->textures(), *file);
    const auto mean = means.Of(emitter, lamp_.textures[0]);
    REQUIRE(mean);
    return *mean;
  }
  TextureBinding& map() { return lamp_.textures[0]; }

 private:
  test::TemporaryFolder folder_;
  std::optional<StoreWriter> writer_;
  Material lamp_;
};

}  // namespace

TEST_CASE("The mean of an emission map is that of the texels that a triangle covers", "[path]") {
  MapFile file;
  const glm::vec3 bright(2, 2 * 0.50289f, 0);
  const auto is = [](const glm::vec3& mean, const glm::vec3& expected, float tolerance) {
    for (int c = 0; c < 3; ++c) CHECK(mean[c] == Approx(expected[c]).margin(tolerance));
  };
  for (const float side : {0.001f, 0.02f, 0.2f}) {
    is(file.MeanAt({0.1f, 0.3f}, side), glm::vec3(0), 0);
    is(file.MeanAt({0.7f, 0.3f}, side), bright, 1e-4f);
  }
  // A quarter of a triangle's area is beyond half of its side.
  is(file.MeanAt({0, 0}, 1), bright * 0.25f, 0.06f * 2);
  // Beyond the image it comes again, or its border goes on.
  is(file.MeanAt({1.1f, 0.3f}, 0.1f), glm::vec3(0), 0);
  file.map().wrap_s = TextureWrap::kClamp;
  is(file.MeanAt({1.1f, 0.3f}, 0.1f), bright, 1e-4f);
  file.map().wrap_s = TextureWrap::kMirror;
  is(file.MeanAt({1.1f, 0.3f}, 0.1f), bright, 1e-4f);
  file.map().transform = {1, 0, 0.5f, 0, 1, 0};
  is(file.MeanAt({0.1f, 0.3f}, 0.1f), bright, 1e-4f);
}

TEST_CASE("Texels that are negative or no numbers are black to a mean", "[path]") {
  const test::TemporaryFolder folder;
  auto writer = StoreWriter::Continue(folder.file("out"), folder.file("part"), {});
  REQUIRE(writer);
  const uint16_t two = 0x4000, nothing = GENERATE(as<uint16_t>(), 0x7E00, 0xC000);  // NaN, and -2
  const TexelLayout layout{2, 1, 1, TexelFormat::kHalf};
  const TextureShape shape(2, 1);
  Bytes texels;  // of level 0, then of its mean
  for (const uint16_t value : {two, nothing, two}) {
    texels.push_back(static_cast<std::byte>(value & 255));
    texels.push_back(static_cast<std::byte>(value >> 8));
  }
  writer->BeginTexture("map", layout);
  REQUIRE(shape.pages() == 1);
  REQUIRE(writer->AddPage(0, EncodeTexturePage(shape, layout, 0, texels)));
  Material screen;
  screen.textures = {{TextureUse::kEmission, 0}};
  Emitter left, right;
  const auto place = [](Emitter& emitter, float s) {
    emitter.uvs[0] = {s, 0.2f};
    emitter.uvs[1] = {s + 0.3f, 0.2f};
    emitter.uvs[2] = {s, 0.8f};
  };
  place(left, 0.1f);
  place(right, 0.6f);
  REQUIRE(writer->Flush());
  const auto file = InputFile::Open(folder.file("part"));
  REQUIRE(file);
  EmissionMeans means(writer->textures(), *file);
  CHECK(*means.Of(left, screen.textures[0]) == glm::vec3(2));
  CHECK(*means.Of(right, screen.textures[0]) == glm::vec3(0));
}

}  // namespace quarry

#include "master/pictures/image_output.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <bit>
#include <catch2/catch.hpp>
#include <limits>
#include <random>

#include "common/math/elementary.h"

namespace quarry::test {
namespace {

RenderJob CroppedJob(const std::string& format) {
  RenderJob job;
  job.view.width = 90;
  job.view.height = 70;
  job.view.crop = {11, 23, 67, 41};
  job.format.name = format;
  return job;
}

std::vector<uint32_t> RandomPixels(const RenderJob& job, std::mt19937& random) {
  std::vector<uint32_t> pixels(size_t{job.view.crop.width} * job.view.crop.height *
                               WordsPerPixel(job.view.aov_mask));
  // All magnitudes, most of them where the encoding is steep.
  for (uint32_t& word : pixels)
    word = random() % 3 == 0 ? random() : std::bit_cast<uint32_t>(static_cast<float>(random()) * 0x1p-32f);
  return pixels;
}

template <class T>
std::vector<T> Read(const Bytes& file, const std::string& name, OIIO::TypeDesc type, OIIO::ImageSpec& spec) {
  OIIO::Filesystem::IOMemReader memory(const_cast<std::byte*>(file.data()), file.size());
  const auto input = OIIO::ImageInput::open(name, nullptr, &memory);
  INFO(OIIO::geterror());
  REQUIRE(input);
  spec = input->spec();
  std::vector<T> values(static_cast<size_t>(spec.width * spec.height * spec.nchannels));
  REQUIRE(input->read_image(0, 0, 0, spec.nchannels, type, values.data()));
  return values;
}

}  // namespace

TEST_CASE("A PNG holds the sRGB encoding of every value") {
  std::mt19937 random(7);
  for (double exposure : {0.0, 3.5, -20.0}) {
    RenderJob job = CroppedJob("png");
    job.format.exposure = exposure;
    std::vector<uint32_t> pixels = RandomPixels(job, random);
    const float special[] = {0.0f,
                             -0.0f,
                             1.0f,
                             -1.0f,
                             std::numeric_limits<float>::infinity(),
                             -std::numeric_limits<float>::infinity(),
                             std::numeric_limits<float>::quiet_NaN()};
    for (size_t i = 0; i < std::size(special); ++i) pixels[i] = std::bit_cast<uint32_t>(special[i]);
    // Covered wholly, not at all, and in part.
    for (size_t p = 0; p < pixels.size() / 4; ++p)
      pixels[4 * p + 3] = std::bit_cast<uint32_t>(p % 3 == 0 ? 1.0f : p % 3 == 1 ? 0.0f : 0.25f);
    const auto file = EncodeImage(job.view, job.format, {}, job.format.exposure.value_or(0), pixels);
    REQUIRE(file.has_value());
    OIIO::ImageSpec spec;
    const auto values = Read<uint8_t>(*file, "x.png", OIIO::TypeUInt8, spec);
    REQUIRE(spec.width == 67);
    REQUIRE(spec.height == 41);
    REQUIRE(spec.nchannels == 3);
    size_t differing = 0;
    for (size_t i = 0; i < values.size(); ++i) {
      const size_t word = 4 * (i / 3) + i % 3;
      const double behind =
          (1 - static_cast<double>(std::bit_cast<float>(pixels[4 * (i / 3) + 3]))) * kBackdrop[i % 3];
      const double linear = static_cast<double>(std::bit_cast<float>(pixels[word])) * Exp2(exposure) + behind;
      differing += values[i] != static_cast<uint8_t>(EncodeSrgb(linear) * 255 + 0.5);
    }
    CHECK(differing == 0);
  }
}

TEST_CASE("An EXR holds every word of the crop, by name") {
  std::mt19937 random(9);
  RenderJob job = CroppedJob("exr");
  job.view.aov_mask = (1u << kAovs) - 1;
  const std::vector<uint32_t> pixels = RandomPixels(job, random);
  const auto file = EncodeImage(job.view, job.format, {}, job.format.exposure.value_or(0), pixels);
  REQUIRE(file.has_value());
  CHECK(*file == *EncodeImage(job.view, job.format, {}, job.format.exposure.value_or(0), pixels));
  OIIO::ImageSpec spec;
  const auto words = Read<uint32_t>(*file, "x.exr", OIIO::TypeUnknown, spec);
  CHECK(spec.x == 11);
  CHECK(spec.y == 23);
  CHECK(spec.full_width == 90);
  CHECK(spec.full_height == 70);
  // By word of the pixel; depths and normals have a second name.
  const std::vector<std::vector<std::string>> names = {{"R"},
                                                       {"G"},
                                                       {"B"},
                                                       {"A"},
                                                       {"depth.Z", "Z"},
                                                       {"normal.X", "N.X"},
                                                       {"normal.Y", "N.Y"},
                                                       {"normal.Z", "N.Z"},
                                                       {"uv.U"},
                                                       {"uv.V"},
                                                       {"primitive.id"},
                                                       {"material.id"},
                                                       {"part.id"},
                                                       {"voxel.id"},
                                                       {"albedo.R"},
                                                       {"albedo.G"},
                                                       {"albedo.B"},
                                                       {"noise.E"},
                                                       {"samples.n"}};
  const auto channels = static_cast<size_t>(spec.nchannels);
  REQUIRE(channels == names.size() + 4);
  for (size_t word = 0; word < names.size(); ++word)
    for (const std::string& name : names[word]) {
      const auto at = static_cast<size_t>(spec.channelindex(name));
      REQUIRE(at < channels);
      CHECK(spec.channelformat(static_cast<int>(at)) ==
            (word < 10 || (word >= 14 && word < 18) ? OIIO::TypeFloat : OIIO::TypeUInt32));
      size_t differing = 0;
      for (size_t p = 0; p < pixels.size() / names.size(); ++p)
        differing += words[p * channels + at] != pixels[p * names.size() + word];
      CHECK(differing == 0);
    }
  CHECK(spec.get_string_attribute("Software").find("Quarry") != std::string::npos);
  CHECK(spec.get_string_attribute("quarryScene") == std::string(32, '0'));
  CHECK(spec.get_string_attribute("quarryCamera").find("fov 45") != std::string::npos);
}

}  // namespace quarry::test

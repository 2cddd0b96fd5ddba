// Small pictures, channel by channel, against those kept here. A change that is meant: tests/golden/update.
#include <OpenImageIO/imageio.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

struct Image {
  OIIO::ImageSpec spec;
  std::vector<uint32_t> words;  ///< every channel is 32 bits
};

Image Read(const std::string& path) {
  auto in = OIIO::ImageInput::open(path);
  INFO(path);
  REQUIRE(in);
  Image image{in->spec(), {}};
  const auto channels = static_cast<size_t>(image.spec.nchannels);
  image.words.resize(static_cast<size_t>(image.spec.width) * static_cast<size_t>(image.spec.height) *
                     channels);
  REQUIRE(in->read_image(0, 0, 0, image.spec.nchannels, OIIO::TypeUnknown, image.words.data()));
  return image;
}

void Compare(const Image& made, const Image& golden) {
  REQUIRE(made.spec.channelnames == golden.spec.channelnames);
  REQUIRE(made.words.size() == golden.words.size());
  const auto channels = static_cast<size_t>(made.spec.nchannels);
  for (size_t c = 0; c < channels; ++c) {
    size_t differing = 0, first = 0;
    for (size_t i = c; i < made.words.size(); i += channels)
      if (made.words[i] != golden.words[i] && differing++ == 0) first = i / channels;
    const auto width = static_cast<size_t>(made.spec.width);
    INFO("channel " << made.spec.channelnames[c] << ": " << differing << " pixels differ, the first at "
                    << first % width << ", " << first / width);
    CHECK(differing == 0);
  }
}

/// The pictures as the programs make them now, rendered once.
const TemporaryFolder& Made() {
  static const TemporaryFolder folder;
  static const int status =
      std::system((std::string(QUARRY_GOLDEN_DIR "/update " QUARRY_BIN_DIR " ") + folder.path()).c_str());
  REQUIRE(status == 0);
  return folder;
}

}  // namespace

TEST_CASE("Pictures are those kept as golden") {
  size_t compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(QUARRY_GOLDEN_DIR)) {
    if (entry.path().extension() != ".exr") continue;
    const std::string name = entry.path().filename().string();
    SECTION(name) { Compare(Read(Made().file(name)), Read(entry.path().string())); }
    ++compared;
  }
  CHECK(compared == 10);
}

}  // namespace quarry::test

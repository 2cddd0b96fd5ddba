// Small pictures, and a frame of a live view, channel by channel, against those kept here. A change that is
// meant: tests/golden/update.
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
  std::vector<std::byte> bytes;
  size_t depth;  ///< bytes a channel, the same in all
};

Image Read(const std::string& path) {
  auto in = OIIO::ImageInput::open(path);
  INFO(path);
  REQUIRE(in);
  Image image{in->spec(), {}, in->spec().channel_bytes()};
  image.bytes.resize(image.spec.image_bytes(true));
  REQUIRE(in->read_image(0, 0, 0, image.spec.nchannels, OIIO::TypeUnknown, image.bytes.data()));
  return image;
}

void Compare(const Image& made, const Image& golden) {
  REQUIRE(made.spec.channelnames == golden.spec.channelnames);
  REQUIRE(made.depth == golden.depth);
  REQUIRE(made.bytes.size() == golden.bytes.size());
  const auto channels = static_cast<size_t>(made.spec.nchannels);
  REQUIRE(made.bytes.size() % (channels * made.depth) == 0);
  for (size_t c = 0; c < channels; ++c) {
    size_t differing = 0, first = 0;
    for (size_t i = c * made.depth; i < made.bytes.size(); i += channels * made.depth)
      if (std::memcmp(&made.bytes[i], &golden.bytes[i], made.depth) != 0 && differing++ == 0)
        first = i / (channels * made.depth);
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

TEST_CASE("Pictures equal the golden pictures") {
  size_t compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(QUARRY_GOLDEN_DIR)) {
    if (const auto kind = entry.path().extension(); kind != ".exr" && kind != ".png") continue;
    const std::string name = entry.path().filename().string();
    SECTION(name) { Compare(Read(Made().file(name)), Read(entry.path().string())); }
    ++compared;
  }
  CHECK(compared == 22);
}

}  // namespace quarry::test

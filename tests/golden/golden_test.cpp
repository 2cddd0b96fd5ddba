// Small pictures, channel by channel, against those kept here. A change that is meant: tests/golden/update.
#include <OpenImageIO/imageio.h>

#include <catch2/catch.hpp>
#include <cstdlib>
#include <cstring>
#include <filesystem>

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

}  // namespace

TEST_CASE("Pictures are those kept as golden") {
  const std::string golden = QUARRY_GOLDEN_DIR;
  std::string folder = (std::filesystem::temp_directory_path() / "quarry-golden-XXXXXX").string();
  REQUIRE(mkdtemp(folder.data()) != nullptr);
  const std::string command = golden + "/update " + QUARRY_BIN_DIR + " " + folder;
  REQUIRE(std::system(command.c_str()) == 0);
  size_t compared = 0;
  for (const auto& entry : std::filesystem::directory_iterator(golden)) {
    if (entry.path().extension() != ".exr") continue;
    SECTION(entry.path().filename().string()) {
      Compare(Read(folder + "/" + entry.path().filename().string()), Read(entry.path().string()));
    }
    ++compared;
  }
  CHECK(compared == 8);
  std::filesystem::remove_all(folder);
}

}  // namespace quarry::test

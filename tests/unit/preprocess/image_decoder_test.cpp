#include "preprocess/texture/image_decoder.h"

#include <OpenImageIO/imageio.h>
#include <fmt/format.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::TemporaryFolder;

ImageDecoding Helper(uint64_t memory = 256u << 20) {
  ::signal(SIGPIPE, SIG_IGN);
  return {std::string(QUARRY_BIN_DIR) + "/quarry-import-image", memory};
}

TextureImage ImageIn(const std::string& file) {
  TextureImage image;
  image.file = file;
  image.name = std::filesystem::path(file).filename().string();
  image.model = "model.mtl";
  return image;
}

/// Texel (x, y), channel c, of every image here: 8 bits.
uint8_t Pattern(int x, int y, int c) {
  return static_cast<uint8_t>(c == 3 ? 255 - x : x * 2 + y * 2 + c * 25);
}

void WriteImage(const std::string& path, int width, int height, int channels, OIIO::TypeDesc type,
                int tile = 0) {
  auto out = OIIO::ImageOutput::create(path);
  REQUIRE(out);
  OIIO::ImageSpec spec(width, height, channels, type);
  spec.tile_width = spec.tile_height = tile;
  spec["oiio:UnassociatedAlpha"] = 1;
  REQUIRE(out->open(path, spec));
  std::vector<uint8_t> texels;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x)
      for (int c = 0; c < channels; ++c) texels.push_back(Pattern(x, y, c));
  REQUIRE(out->write_image(OIIO::TypeDesc::UINT8, texels.data()));
  REQUIRE(out->close());
}

struct Decoded {
  ImageFacts facts;
  Bytes rows;
  std::string error;
};

Decoded Decode(ImageDecoder& decoder, const TextureImage& image) {
  Decoded decoded;
  const Status status = decoder.Decode(
      image,
      [&](const ImageFacts& facts) -> Status {
        decoded.facts = facts;
        return {};
      },
      [&](std::span<const std::byte> row) -> Status {
        decoded.rows.insert(decoded.rows.end(), row.begin(), row.end());
        return {};
      });
  if (!status) decoded.error = status.error().message;
  return decoded;
}

std::string ReadText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

TEST_CASE("Images of all supported formats are read", "[texture][decoder]") {
  const TemporaryFolder folder;
  ImageDecoder decoder(Helper());
  struct Kind {
    const char* name;
    int channels;
    OIIO::TypeDesc type;
    int off;  ///< of 255, that a lossy format may be
    int tile = 0;
  };
  using Type = OIIO::TypeDesc;
  for (const Kind& kind : {Kind{"a.png", 3, Type::UINT8, 0}, Kind{"grey.png", 1, Type::UINT8, 0},
                           Kind{"alpha.png", 4, Type::UINT8, 0}, Kind{"both.png", 2, Type::UINT8, 0},
                           Kind{"deep.png", 3, Type::UINT16, 0}, Kind{"a.jpg", 3, Type::UINT8, 40},
                           Kind{"a.tga", 3, Type::UINT8, 0}, Kind{"alpha.tga", 4, Type::UINT8, 0},
                           Kind{"a.bmp", 3, Type::UINT8, 0}, Kind{"a.tif", 3, Type::UINT8, 0},
                           Kind{"tiled.tif", 3, Type::UINT8, 0, 16}, Kind{"deep.tif", 1, Type::UINT16, 0},
                           Kind{"a.exr", 3, Type::HALF, 1}, Kind{"tiled.exr", 4, Type::FLOAT, 1, 32},
                           Kind{"a.hdr", 3, Type::FLOAT, 3}, Kind{"a.ppm", 3, Type::UINT8, 0},
                           Kind{"a.webp", 3, Type::UINT8, 60}}) {
    CAPTURE(kind.name);
    const std::string path = folder.file(kind.name);
    WriteImage(path, 50, 37, kind.channels, kind.type, kind.tile);
    for (const bool inside : {false, true}) {
      CAPTURE(inside);
      TextureImage image = ImageIn(path);
      if (inside) {  // as a GLB has it
        image.size = std::filesystem::file_size(path);
        image.offset = 1001;
        std::ofstream(path + ".glb", std::ios::binary)
            << std::string(1001, 'x') << ReadText(path) << std::string(500, 'y');
        image.file = path + ".glb";
        if (path.ends_with(".tga")) continue;  // its bytes do not name its format
      }
      const Decoded decoded = Decode(decoder, image);
      REQUIRE(decoded.error == "");
      CHECK(decoded.facts.width == 50);
      CHECK(decoded.facts.height == 37);
      CHECK(decoded.facts.channels == static_cast<uint32_t>(kind.channels));
      CHECK(decoded.facts.real == (kind.type.size() > 1));
      CHECK(decoded.facts.encoded == (kind.type == Type::UINT16));
      REQUIRE(decoded.rows.size() == 37 * decoded.facts.row_bytes());
      const auto value = [&](size_t i) {
        if (!decoded.facts.real) return static_cast<double>(decoded.rows[i]);
        float real;
        std::memcpy(&real, &decoded.rows[i * 4], 4);
        // The colours written are multiplied by alpha, as EXR has them; the decoded colours are divided by
        // it.
        const size_t last = i | 3;
        if (kind.channels < 4 || i == last) return static_cast<double>(real) * 255;
        float alpha;
        std::memcpy(&alpha, &decoded.rows[last * 4], 4);
        return static_cast<double>(real) * 255 * static_cast<double>(alpha);
      };
      double worst = 0;
      for (int y = 0; y < 37; ++y)
        for (int x = 0; x < 50; ++x)
          for (int c = 0; c < kind.channels; ++c) {
            // Grey and alpha: alpha is the second.
            const int of = kind.channels == 2 && c == 1 ? 1 : c;
            const size_t at =
                (static_cast<size_t>(y) * 50 + static_cast<size_t>(x)) * static_cast<size_t>(kind.channels) +
                static_cast<size_t>(c);
            worst = std::max(worst, std::fabs(value(at) - Pattern(x, y, of)));
          }
      CHECK(worst <= kind.off + 0.01);
    }
  }
}

TEST_CASE("Colours come without alpha, also where a format or its reader has multiplied them",
          "[texture][decoder]") {
  const TemporaryFolder folder;
  ImageDecoder decoder(Helper());
  // WebP, lossless, by libwebp itself: (200 100 50 128) (10 20 30 255) (100 0 200 64) (40 80 120 200).
  const uint8_t webp[] = {0x52, 0x49, 0x46, 0x46, 0x3c, 0x00, 0x00, 0x00, 0x57, 0x45, 0x42, 0x50, 0x56, 0x50,
                          0x38, 0x4c, 0x2f, 0x00, 0x00, 0x00, 0x2f, 0x03, 0x00, 0x00, 0x10, 0x1f, 0x20, 0x10,
                          0x20, 0x26, 0x84, 0x49, 0x15, 0x26, 0x48, 0x48, 0x40, 0x74, 0x9b, 0x8c, 0xb1, 0xd4,
                          0x36, 0x21, 0x01, 0x19, 0x3b, 0x21, 0x9b, 0x23, 0x13, 0x12, 0x10, 0xf7, 0x4c, 0x52,
                          0x2d, 0x17, 0xe0, 0x4e, 0x17, 0xb9, 0x68, 0x6c, 0x44, 0xff, 0x03, 0x00};
  std::ofstream(folder.file("a.webp"), std::ios::binary)
      .write(reinterpret_cast<const char*>(webp), sizeof webp);
  const Decoded decoded = Decode(decoder, ImageIn(folder.file("a.webp")));
  REQUIRE(decoded.error == "");
  REQUIRE(decoded.facts.channels == 4);
  const int wanted[] = {200, 100, 50, 128, 10, 20, 30, 255, 100, 0, 200, 64, 40, 80, 120, 200};
  REQUIRE(decoded.rows.size() == 16);
  // Colours multiplied by alpha are rounded to 8 bits, and again after the division.
  for (size_t i = 0; i < 16; ++i)
    CHECK(std::abs(static_cast<int>(decoded.rows[i]) - wanted[i]) <= (i % 4 == 3 ? 0 : 255 / wanted[i | 3]));

  auto out = OIIO::ImageOutput::create("a.exr");
  REQUIRE(out);
  REQUIRE(out->open(folder.file("a.exr"), OIIO::ImageSpec(2, 1, 4, OIIO::TypeDesc::FLOAT)));
  const float texels[] = {0.25f, 0.5f, 0.125f, 0.5f, 3, 2, 1, 0};  // multiplied, as EXR has it; and a glow
  REQUIRE(out->write_image(OIIO::TypeDesc::FLOAT, texels));
  REQUIRE(out->close());
  const Decoded exr = Decode(decoder, ImageIn(folder.file("a.exr")));
  REQUIRE(exr.error == "");
  float real[8];
  REQUIRE(exr.rows.size() == sizeof real);
  std::memcpy(real, exr.rows.data(), sizeof real);
  const float divided[] = {0.5f, 1, 0.25f, 0.5f, 3, 2, 1, 0};
  for (size_t i = 0; i < 8; ++i) CHECK(real[i] == divided[i]);
}

TEST_CASE("A file that is no image, or half of one, is refused with its name and its model's",
          "[texture][decoder]") {
  const TemporaryFolder folder;
  ImageDecoder decoder(Helper());
  const auto refused = [&](const std::string& name, const std::string& content) {
    std::ofstream(folder.file(name), std::ios::binary) << content;
    const std::string error = Decode(decoder, ImageIn(folder.file(name))).error;
    CHECK_FALSE(decoder.is_fatal());
    CHECK(error.find(folder.file(name) + " (of model.mtl): cannot be read as an image: ") == 0);
    CHECK(error.find('\n') == std::string::npos);
    return error;
  };
  CHECK(refused("text.png", "this is no image").find("is not an image of a format that is read") !=
        std::string::npos);
  CHECK(refused("empty.jpg", "").find("is not an image of a format") != std::string::npos);
  // Formats that OpenImageIO knows, and that are no textures.
  CHECK(refused("page.gif", "GIF89a and so on").find("is not an image of a format") != std::string::npos);
  WriteImage(folder.file("whole.png"), 200, 200, 3, OIIO::TypeDesc::UINT8);
  const std::string whole = ReadText(folder.file("whole.png"));
  refused("cut.png", whole.substr(0, whole.size() / 2));
  refused("start.png", whole.substr(0, 20));
  // Sides that cannot be: the header's, with its own checksum right.
  WriteImage(folder.file("wide.ppm"), 2, 2, 3, OIIO::TypeDesc::UINT8);
  CHECK(refused("wide.ppm", "P6\n40000 2\n255\n" + std::string(240000, 'a')).find("40000 x 2 pixels large") !=
        std::string::npos);
  CHECK(Decode(decoder, ImageIn(folder.file("not there.png"))).error.find("not there.png") !=
        std::string::npos);
  // And goes on.
  CHECK(Decode(decoder, ImageIn(folder.file("whole.png"))).error == "");
  CHECK(decoder.LookAt(ImageIn(folder.file("whole.png")))->width == 200);
  CHECK_FALSE(decoder.LookAt(ImageIn(folder.file("text.png"))));
}

TEST_CASE("Damaged images never harm the program that has them decoded", "[texture][decoder]") {
  const TemporaryFolder folder;
  ImageDecoder decoder(Helper());
  std::mt19937 random(3);
  int refused = 0, read = 0;
  for (const char* name : {"a.png", "a.jpg", "a.tif", "a.exr", "a.tga", "a.hdr", "a.bmp", "a.webp"}) {
    const std::string path = folder.file(name);
    WriteImage(path, 64, 40, 3, OIIO::TypeDesc::UINT8);
    const std::string whole = ReadText(path);
    for (int i = 0; i < 20; ++i) {
      std::string bad = whole;
      for (int k = 0; k < 4; ++k) bad[random() % bad.size()] = static_cast<char>(random());
      if (i % 3 == 0) bad.resize(random() % bad.size());
      std::ofstream(path, std::ios::binary) << bad;
      const Decoded decoded = Decode(decoder, ImageIn(path));
      // Unless it claims to be so large that its decoder takes too much for it.
      CHECK(decoder.is_fatal() == (decoded.error.find("more than --memory") != std::string::npos));
      ++(decoded.error.empty() ? read : refused);
      if (decoded.error.empty())
        CHECK(decoded.rows.size() == decoded.facts.height * decoded.facts.row_bytes());
    }
  }
  CHECK(refused > 40);
  CHECK(refused + read == 160);
}

TEST_CASE("A decoder that crashes costs one image, and one that is short of memory ends the run",
          "[texture][decoder][long]") {
  const TemporaryFolder folder;
  WriteImage(folder.file("a.png"), 20, 20, 3, OIIO::TypeDesc::UINT8);
  Helper();
  ImageDecoder useless({"/bin/false", 1 << 20});
  CHECK(Decode(useless, ImageIn(folder.file("a.png"))).error.find("/bin/false, has ended before its first") !=
        std::string::npos);
  CHECK(useless.is_fatal());
  ImageDecoder missing({folder.file("not there"), 1 << 20});
  CHECK(Decode(missing, ImageIn(folder.file("a.png"))).error.find("cannot be started") != std::string::npos);
  CHECK(missing.is_fatal());
  ImageDecoder none({"", 1 << 20});
  CHECK(Decode(none, ImageIn(folder.file("a.png"))).error.find("--no-textures") != std::string::npos);
  CHECK(none.is_fatal());
  // TGA is held whole by its decoder.
  WriteImage(folder.file("large.tga"), 8000, 8000, 3, OIIO::TypeDesc::UINT8);
  ImageDecoder small(Helper(32 << 20));
  const std::string error = Decode(small, ImageIn(folder.file("large.tga"))).error;
  CHECK(error.find("needs more than --memory to be decoded") != std::string::npos);
  CHECK(small.is_fatal());
  ImageDecoder large(Helper(512 << 20));
  CHECK(Decode(large, ImageIn(folder.file("large.tga"))).error == "");
}

TEST_CASE("A decoder that never ends is killed, and the run ends", "[texture][decoder]") {
  const TemporaryFolder folder;
  WriteImage(folder.file("a.png"), 20, 20, 3, OIIO::TypeDesc::UINT8);
  ImageDecoder decoder(Helper());
  REQUIRE(Decode(decoder, ImageIn(folder.file("a.png"))).error == "");
  const std::string limit = fmt::format(
      "test $(prlimit --cpu -o SOFT --noheadings --pid $(pgrep -n -P {} quarry-import)) -gt 500", ::getpid());
  CHECK(std::system(limit.c_str()) == 0);
  const std::string program = folder.file("circling");
  std::ofstream(program) << "#!/bin/sh\nkill -XCPU $$\n";
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  ImageDecoder circling({program, 1 << 20});
  // Its first answer never arrives, but the cause of its end is known.
  CHECK(
      Decode(circling, ImageIn(folder.file("a.png"))).error.find("took its decoder more than ten minutes") !=
      std::string::npos);
  CHECK(circling.is_fatal());
}

TEST_CASE("An error of the receiver of rows ends the image, and the next image is read as usual",
          "[texture][decoder]") {
  const TemporaryFolder folder;
  WriteImage(folder.file("a.png"), 2000, 2000, 3, OIIO::TypeDesc::UINT8);
  ImageDecoder decoder(Helper());
  const Status status = decoder.Decode(
      ImageIn(folder.file("a.png")), [](const ImageFacts&) { return Status{}; },
      [](std::span<const std::byte>) -> Status { return Fail("disk full"); });
  CHECK(status.error().message == "disk full");
  CHECK(decoder.is_fatal());
  CHECK(Decode(decoder, ImageIn(folder.file("a.png"))).rows.size() == 2000 * 2000 * 3);
}

TEST_CASE("A helper that answers nonsense and lives on is not waited for", "[texture][decoder]") {
  const TemporaryFolder folder;
  Helper();
  const std::string program = folder.file("astray");
  // Rows of four gigabytes.
  std::ofstream(program) << "#!/bin/sh\nprintf '\\004\\000\\000\\000\\377\\377\\377\\377'\nexec sleep 1000\n";
  std::filesystem::permissions(program, std::filesystem::perms::owner_all);
  ImageDecoder decoder({program, 1 << 20});
  CHECK(Decode(decoder, ImageIn(folder.file("a.png"))).error.find("the decoder gives an invalid answer") !=
        std::string::npos);
  CHECK_FALSE(decoder.is_fatal());
}

TEST_CASE("An image in a folder named like a memory error is refused like any other", "[texture][decoder]") {
  const TemporaryFolder folder;
  std::filesystem::create_directory(folder.file("memory alloc"));
  ImageDecoder decoder(Helper());
  for (const char* name : {"a.jpg", "a.png", "a.tif", "gone.png"}) {
    CAPTURE(name);
    const std::string path = folder.file("memory alloc/") + name;
    if (name != std::string("gone.png")) {
      WriteImage(path, 200, 150, 3, OIIO::TypeDesc::UINT8);
      std::filesystem::resize_file(path, std::filesystem::file_size(path) / 2);
    }
    const Decoded decoded = Decode(decoder, ImageIn(path));
    CHECK_FALSE(decoder.is_fatal());
    CHECK(decoded.error.find("needs more than --memory") == std::string::npos);
    // The path once, at the beginning.
    CHECK(decoded.error.rfind("memory alloc") == decoded.error.find("memory alloc"));
  }
}

TEST_CASE("An EXR whose display window differs from its data window is refused", "[texture][decoder]") {
  const TemporaryFolder folder;
  OIIO::ImageSpec spec(4, 4, 3, OIIO::TypeDesc::HALF);
  spec.x = 2;
  spec.full_width = spec.full_height = 8;
  auto out = OIIO::ImageOutput::create("a.exr");
  REQUIRE(out);
  REQUIRE(out->open(folder.file("a.exr"), spec));
  REQUIRE(out->write_image(OIIO::TypeDesc::FLOAT, std::vector<float>(48).data()));
  REQUIRE(out->close());
  ImageDecoder decoder(Helper());
  CHECK(Decode(decoder, ImageIn(folder.file("a.exr"))).error.find("another window") != std::string::npos);
  CHECK_FALSE(decoder.is_fatal());
}

TEST_CASE("A damaged EXR is refused as an image, whatever memory it claims", "[texture][decoder]") {
  const TemporaryFolder folder;
  const std::string sound = folder.file("sound.exr"), damaged = folder.file("damaged.exr");
  WriteImage(sound, 8, 8, 3, OIIO::TypeDesc::HALF);
  const std::string bytes = ReadText(sound);
  ImageDecoder decoder(Helper(64u << 20));
  int refused = 0;
  // Any word of the header large: windows, lengths of attributes, counts of channels.
  for (const uint32_t word : {0x7FFFFFFFu, 0x3FFFFFFFu, 0x00FFFFFFu, 30000u})
    for (size_t at = 4; at + 4 <= std::min<size_t>(bytes.size(), 420); at += 3) {
      std::string changed = bytes;
      std::memcpy(&changed[at], &word, sizeof word);
      std::ofstream(damaged, std::ios::binary) << changed;
      const Decoded decoded = Decode(decoder, ImageIn(damaged));
      CAPTURE(at, word, decoded.error);
      REQUIRE_FALSE(decoder.is_fatal());
      if (decoded.error.empty()) continue;
      ++refused;
      REQUIRE_THAT(decoded.error, Catch::Contains("damaged.exr"));
    }
  CHECK(refused > 100);
}

}  // namespace quarry

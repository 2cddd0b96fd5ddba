#include "preprocess/spill/spill_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <random>
#include <utility>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// Packs well, as a triangle's record does.
struct Element {
  uint32_t number;
  uint32_t same[11];
};

Element Numbered(uint64_t i) { return {static_cast<uint32_t>(i * 2654435761u), {7, 7, 7}}; }

bool Holds(const Element& e, uint64_t i) {
  const Element wanted = Numbered(i);
  return std::memcmp(&e, &wanted, sizeof e) == 0;
}

void AppendUpTo(SpillFile& file, uint64_t count) {
  while (file.count() < count) {
    const Element e = Numbered(file.count());
    REQUIRE(file.Append(&e));
  }
}

size_t WrongIn(const SpillFile& file, uint64_t first, uint64_t last) {
  std::vector<Element> read(last - first);
  REQUIRE(file.Read(first, std::as_writable_bytes(std::span(read))));
  size_t wrong = 0;
  for (size_t i = 0; i < read.size(); ++i) wrong += !Holds(read[i], first + i);
  return wrong;
}

size_t WrongWhenWalked(const SpillFile& file, uint64_t first, uint64_t last) {
  SpillReader reader(file, first, last);
  size_t wrong = 0;
  uint64_t i = first;
  for (; const std::byte* bytes = reader.Next(); ++i) {
    Element e;
    std::memcpy(&e, bytes, sizeof e);
    wrong += !Holds(e, i);
  }
  REQUIRE(reader.status());
  return wrong + (i != last);
}

constexpr uint64_t kCount = 100000;

}  // namespace

TEST_CASE("Spill files return the appended bytes, packed or not, written here or by a writer") {
  const test::TemporaryFolder folder;
  SpillWriter writer;
  uint64_t bytes[2] = {};
  for (const bool packed : {false, true})
    for (SpillWriter* const by : {static_cast<SpillWriter*>(nullptr), &writer})
      for (const size_t block : {size_t{4096}, size_t{100000}, SpillFile::kBlockBytes}) {
        SpillFile::Options options;
        options.pack_from = packed ? SpillFile::kPackAll : SpillFile::kPackNone;
        options.block_bytes = block;
        options.writer = by;
        const std::string path = folder.file("spill");
        auto file = SpillFile::Open(path, sizeof(Element), 0, options);
        REQUIRE(file.has_value());
        AppendUpTo(*file, kCount / 3);
        REQUIRE(file->WriteOut());  // a block that is not full
        AppendUpTo(*file, kCount);
        REQUIRE(file->FinishWriting());
        bytes[packed] = std::filesystem::file_size(path);
        CHECK(WrongIn(*file, 0, kCount) == 0);
        CHECK(WrongWhenWalked(*file, 0, kCount) == 0);
        std::mt19937 random(3);
        for (int i = 0; i < 50; ++i) {
          const uint64_t a = random() % kCount, b = a + random() % (kCount - a);
          REQUIRE(WrongIn(*file, a, b) == 0);
          REQUIRE(WrongWhenWalked(*file, a, b) == 0);
        }
        Element beyond;
        CHECK_FALSE(file->Read(kCount, std::as_writable_bytes(std::span(&beyond, 1))).has_value());
        // Another process finds the file; a part given back is gone, and the part behind it is not.
        SpillFile left = SpillFile::Left(path, sizeof(Element), kCount);
        CHECK(WrongIn(left, 0, kCount) == 0);
        const auto room = [&] {
          struct stat info {};
          REQUIRE(::stat(path.c_str(), &info) == 0);
          return info.st_blocks;
        };
        const auto before = room();
        left.Discard(0, kCount / 2);
        if (block == 100000 && !packed) CHECK(room() < before * 3 / 4);
        const SpillFile again = SpillFile::Left(path, sizeof(Element), kCount);
        CHECK(WrongIn(again, kCount / 2, kCount) == 0);
        left.Remove();
        CHECK_FALSE(std::filesystem::exists(path));
      }
  CHECK(bytes[1] * 2 < bytes[0]);
}

TEST_CASE("Spill files are packed above a length") {
  const test::TemporaryFolder folder;
  SpillFile::Options options;
  options.pack_from = 1 << 20;
  options.block_bytes = 64 << 10;
  auto file = SpillFile::Open(folder.file("spill"), sizeof(Element), 0, options);
  REQUIRE(file.has_value());
  AppendUpTo(*file, kCount);
  REQUIRE(file->FinishWriting());
  CHECK(WrongIn(*file, 0, kCount) == 0);
  const uint64_t bytes = std::filesystem::file_size(folder.file("spill"));
  CHECK(bytes > 1 << 20);
  CHECK(bytes < kCount * sizeof(Element) / 2);
}

TEST_CASE("A spill file continues where it was synchronised, and only there") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spill");
  {
    auto file = SpillFile::Open(path, sizeof(Element), 0);
    REQUIRE(file.has_value());
    AppendUpTo(*file, kCount / 2);
    REQUIRE(file->WriteOut());
    AppendUpTo(*file, kCount);
    REQUIRE(file->FinishWriting());
  }
  auto file = SpillFile::Open(path, sizeof(Element), kCount / 2);
  REQUIRE(file.has_value());
  AppendUpTo(*file, kCount / 2 + 100);
  REQUIRE(file->FinishWriting());
  CHECK(WrongIn(*file, 0, kCount / 2 + 100) == 0);
  const auto refused = [&](uint64_t count) {
    const auto opened = SpillFile::Open(path, sizeof(Element), count);
    return !opened && opened.error().message.find("start again without --resume") != std::string::npos;
  };
  CHECK(refused(kCount));
  CHECK(refused(kCount / 2 + 50));  // within a block
}

TEST_CASE("Damage of a packed spill file is noticed") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spill");
  auto file = SpillFile::Open(path, sizeof(Element), 0, {.pack_from = SpillFile::kPackAll});
  REQUIRE(file.has_value());
  AppendUpTo(*file, 1000);
  REQUIRE(file->FinishWriting());
  std::filesystem::resize_file(path, std::filesystem::file_size(path) - 10);
  std::vector<Element> read(1000);
  CHECK_FALSE(file->Read(0, std::as_writable_bytes(std::span(read))).has_value());
  std::filesystem::resize_file(path, std::filesystem::file_size(path) + 10);  // zeros
  CHECK_FALSE(file->Read(0, std::as_writable_bytes(std::span(read))).has_value());
}

TEST_CASE("Headers of a spill file's blocks are checked", "[resume]") {
  const test::TemporaryFolder folder;
  const std::string path = folder.file("spill");
  {
    auto file = SpillFile::Open(path, sizeof(Element), 0);
    REQUIRE(file.has_value());
    AppendUpTo(*file, 1000);
    REQUIRE(file->WriteOut());
  }
  const auto damage = [&](uint32_t elements, uint32_t stored) {
    const int fd = ::open(path.c_str(), O_WRONLY);
    const uint32_t header[] = {elements, stored};
    REQUIRE(::pwrite(fd, header, sizeof header, 0) == sizeof header);
    ::close(fd);
  };
  Element element;
  const auto out = std::as_writable_bytes(std::span(&element, 1));
  constexpr uint32_t kMany = 400'000'000;
  for (const auto& [elements, stored] :
       {std::pair{kMany, 100u}, {0u, 48000u}, {1000u, 48001u}, {1000u, ~0u}, {10u, 48000u}}) {
    damage(elements, stored);
    CHECK_FALSE(SpillFile::Open(path, sizeof(Element), kMany).has_value());
    const SpillFile left = SpillFile::Left(path, sizeof(Element), kMany);
    CHECK_FALSE(left.Read(0, out).has_value());
    SpillReader reader(left);
    CHECK(reader.Next() == nullptr);
    CHECK_FALSE(reader.status().has_value());
    left.Discard(0, kMany);
  }
}

TEST_CASE("A writer that fails returns its error to all waiting threads") {
  SpillWriter writer;
  SpillBlock block;
  block.MakeRoom(10);
  block.size = 10;
  int written = 0;
  REQUIRE(writer.Give(block, [](std::span<const std::byte>) -> Status { return Fail("full"); }));
  CHECK_FALSE(writer.Wait().has_value());
  block.MakeRoom(10);
  block.size = 10;
  CHECK_FALSE(writer
                  .Give(block,
                        [&](std::span<const std::byte>) {
                          ++written;
                          return Status{};
                        })
                  .has_value());
  CHECK(writer.Wait().error().message == "full");
  CHECK(written == 0);
}

}  // namespace quarry

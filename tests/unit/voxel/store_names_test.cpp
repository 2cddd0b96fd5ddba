// Stores of strangers, whose names and sizes lie, and of models with very many parts.
#include <malloc.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "common/voxel/store_description.h"
#include "common/voxel/store_header.h"
#include "common/voxel/store_reader.h"
#include "common/voxel/store_writer.h"
#include "tests/fuzz/store_mend.h"
#include "tests/support/stores/changed_store.h"
#include "tests/support/stores/small_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::Changed;
using test::TemporaryFolder;

constexpr uint64_t kMiB = 1 << 20;

SceneId WriteNamed(const std::string& path, const std::vector<std::string>& parts,
                   std::vector<Material> materials = {Material{"paint"}}, const SceneViews& views = {},
                   const std::vector<std::string>& models = {}) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer);
  REQUIRE(writer->AddVoxel(EncodeVoxel(test::TwoTriangles(), nullptr)));
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.input_triangles = 2;
  const auto id =
      writer->Finish(meta, {KdNode::Leaf(0, 1)}, materials, test::RootParts(parts), views, models);
  REQUIRE(id);
  return *id;
}

uint64_t AllocatedBytes() {
  const struct mallinfo2 info = ::mallinfo2();
  return info.uordblks + info.hblkhd;
}

}  // namespace

TEST_CASE("A million parts take no memory of a store's reader", "[store]") {
  const TemporaryFolder folder;
  {
    std::vector<std::string> parts;
    for (int i = 0; i < 1000000; ++i)
      parts.push_back("building 7/floor 3/pipe rack/valve number " + std::to_string(i));
    WriteNamed(folder.file("s"), parts);
  }
  const uint64_t before = AllocatedBytes();
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  CHECK(store->part_count() == 1000000);
  CHECK(store->PartName(999999) == "building 7/floor 3/pipe rack/valve number 999999");
  CHECK(store->PartName(3) == "building 7/floor 3/pipe rack/valve number 3");
  CHECK(store->PartName(1000000) == "");
  CHECK(AllocatedBytes() < before + kMiB);
  // In order, every name is right, on both sides of each window's border too.
  uint64_t wrong = 0;
  for (uint32_t i = 0; i < 1000000; ++i)
    wrong += store->PartName(i) != "building 7/floor 3/pipe rack/valve number " + std::to_string(i);
  CHECK(wrong == 0);
}

TEST_CASE("Entries that all name one long string take no memory for each", "[store]") {
  const TemporaryFolder folder;
  const std::string long_name(600000, 'n');
  SceneViews views;
  for (int i = 0; i < 2000; ++i) views.cameras.push_back({"c", {{1, 2, 3}, {4, 5, 6}, {0, 1, 0}, 30, 0}});
  WriteNamed(folder.file("s"), {long_name, "a", "b"}, std::vector<Material>(60000), views);
  Changed store(folder.file("s"));
  const uint64_t parts = store.Begin(SectionType::kParts), materials = store.Begin(SectionType::kMaterials);
  const auto where = store.Get<uint32_t>(parts);
  for (uint64_t i = 0; i < 3; ++i) store.Put(parts + 4 * i, where);
  for (uint64_t i = 0; i < 60000; ++i) store.Put(materials + 4 + kMaterialBytes * i, where);
  fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
  const uint64_t before = AllocatedBytes();
  {
    const auto reader = store.Open();
    REQUIRE(reader);
    CHECK(reader->PartName(2) == std::string(kMostNameBytes, 'n'));
    CHECK(reader->MaterialName(59999) == std::string(kMostNameBytes, 'n'));
    CHECK(AllocatedBytes() < before + store.bytes.size() + 40 * kMiB);
  }
  const auto described = DescribeStore(*store.Open());
  REQUIRE_FALSE(described);
  CHECK_THAT(described.error().message, Catch::Contains("refer to more names than it has"));
  // Cameras keep their names, so that they have a limit together.
  const uint64_t cameras = store.Begin(SectionType::kCameras);
  for (uint64_t i = 0; i < 2000; ++i) store.Put(cameras + 96 * i, where);
  fuzz::MendStore(std::as_writable_bytes(std::span(store.bytes)));
  const auto refused = store.Open();
  REQUIRE_FALSE(refused);
  CHECK_THAT(refused.error().message, Catch::Contains("names of its cameras and lights take more than"));
}

TEST_CASE("The size of a section is checked before use", "[store]") {
  const TemporaryFolder folder;
  WriteNamed(folder.file("s"), {"part"});
  SECTION("larger than its type may be") {
    Changed store(folder.file("s"));
    const uint64_t entry = store.Entry(SectionType::kMeta);
    store.Put(entry + 16, uint64_t{6} << 30);
    // The sections behind it move, so that the table is consistent.
    uint64_t end = store.Get<uint64_t>(entry + 8) + (uint64_t{6} << 30);
    const uint64_t table_end = kStoreHeaderBytes + kSectionEntryBytes * store.Get<uint32_t>(12);
    for (uint64_t at = entry + kSectionEntryBytes; at < table_end; at += kSectionEntryBytes) {
      store.Put(at + 8, end);
      end += store.Get<uint64_t>(at + 16);
    }
    store.size = end;
    store.MendTable();
    const auto refused = store.Open();
    REQUIRE_FALSE(refused);
    CHECK_THAT(refused.error().message, Catch::Contains("section META claims 6442450944 bytes"));
    CHECK(store.counts->read < 4096);
  }
  SECTION("zeros of a sparse file") {
    Changed store(folder.file("s"));
    const uint64_t directory = store.Entry(SectionType::kDirectory);
    store.Put(directory, uint32_t{0x58585858});  // unknown now, and not critical
    store.Put(directory + 4, uint32_t{0});
    store.ClaimLast(SectionType::kDirectory, uint64_t{900} << 20);
    const auto refused = store.Open();
    REQUIRE_FALSE(refused);
    CHECK_THAT(refused.error().message, Catch::Contains("section VDIR") && Catch::Contains("zeros"));
    CHECK(store.counts->read < 20 * kMiB);
  }
  SECTION("an unknown section is not read") {
    Changed store(folder.file("s"));
    store.ClaimLast(static_cast<SectionType>(0x58585858), uint64_t{6} << 30);
    CHECK(store.Open());
    CHECK(store.counts->read < kMiB);
  }
  SECTION("no section comes twice") {
    Changed store(folder.file("s"));
    store.ClaimLast(SectionType::kCameras, 0);
    const auto refused = store.Open();
    REQUIRE_FALSE(refused);
    CHECK_THAT(refused.error().message, Catch::Contains("has two sections CAMS"));
  }
}

TEST_CASE("A store names its models' files, which are no part of the scene", "[store]") {
  const TemporaryFolder folder;
  std::vector<std::string> tiles;
  for (int i = 0; i < 300; ++i) tiles.push_back("tile" + std::to_string(i) + ".obj");
  tiles[1] = std::string(300, 'n');
  const SceneId nameless = WriteNamed(folder.file("nameless"), {"a"});
  CHECK(WriteNamed(folder.file("tiles"), {"a"}, {Material{"paint"}}, {}, tiles) == nameless);
  CHECK(StoreReader::Open(folder.file("nameless"))->models().count == 0);
  const auto store = StoreReader::Open(folder.file("tiles"));
  REQUIRE(store);
  CHECK(store->models().count == 300);
  REQUIRE(store->models().names.size() == kMostModelNames);
  CHECK(store->models().names[0] == "tile0.obj");
  CHECK(store->models().names[1] == std::string(kMostModelNameBytes, 'n'));
  CHECK(store->models().names[255] == "tile255.obj");
}

TEST_CASE("A section of models that states a wrong number of names is refused", "[store]") {
  const TemporaryFolder folder;
  WriteNamed(folder.file("s"), {"a"}, {Material{"paint"}}, {}, {"plant.obj", "pipes.ply"});
  for (const uint32_t count : {0u, 1u, 3u, 257u, ~0u}) {
    Changed store(folder.file("s"));
    const uint64_t entry = store.Entry(SectionType::kModels), begin = store.Begin(SectionType::kModels);
    store.Put(begin, count);
    const auto section =
        std::as_bytes(std::span(store.bytes)).subspan(begin, store.Get<uint64_t>(entry + 16));
    store.Put(entry + 24, Checksum(section));
    store.MendTable();
    const auto refused = store.Open();
    REQUIRE_FALSE(refused);
    CHECK_THAT(refused.error().message,
               Catch::Contains("section MDLS") && Catch::Contains("number of names"));
  }
}

}  // namespace quarry

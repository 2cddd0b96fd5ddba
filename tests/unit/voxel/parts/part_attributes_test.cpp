#include "common/voxel/parts/part_attributes.h"

#include <catch2/catch.hpp>
#include <string>

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

void WriteStore(const std::string& path, const PartTable& table) {
  auto writer = StoreWriter::Create(path);
  REQUIRE(writer);
  REQUIRE(writer->AddVoxel(EncodeVoxel(test::TwoTriangles(), nullptr)));
  SceneMeta meta;
  meta.bounds_upper = meta.root_upper = glm::vec3(1);
  meta.input_triangles = 2;
  REQUIRE(writer->Finish(meta, {KdNode::Leaf(0, 1)}, {Material{"paint"}}, table));
}

}  // namespace

TEST_CASE("A store returns the attributes of its parts", "[parts]") {
  const TemporaryFolder folder;
  PartTable table = test::RootParts({"a", "b", "c", "d", "e", "f", "g"});
  table.attributes = {{1, R"({"tag":"H"})"}, {4, R"({"a":[1,{"b":null}]})"}, {6, R"({"":""})"}};
  WriteStore(folder.file("s"), table);
  CHECK(test::FaultOf(folder.file("s")).empty());
  const auto store = StoreReader::Open(folder.file("s"));
  REQUIRE(store);
  const auto attributes = store->part_sections().ReadAttributes();
  REQUIRE(attributes);
  CHECK(attributes->size() == 3);
  for (const StatedAttributes& stated : table.attributes) CHECK(attributes->Of(stated.part) == stated.json);
  for (const uint32_t part : {0u, 2u, 5u, 7u, ~0u}) CHECK(attributes->Of(part) == std::string());

  // Damaged, with checksums that fit.
  const auto fault = [&](uint64_t at, uint32_t value) {
    Changed changed(folder.file("s"));
    changed.Put(changed.Begin(SectionType::kPartAttributes) + at, value);
    fuzz::MendStore(std::as_writable_bytes(std::span(changed.bytes)));
    const auto opened = changed.Open();
    REQUIRE(opened);
    CHECK_FALSE(opened->Verify([](uint64_t, uint64_t) {}));
    const auto read = opened->part_sections().ReadAttributes();
    return read ? read->Check().error().message : read.error().message;
  };
  for (const uint32_t count : {0u, 2u, 4u, 1000u, ~0u})
    CHECK_THAT(fault(0, count), Catch::Contains("section PATT"));
  for (const uint32_t part : {0u, 1u, 6u, 7u, ~0u})
    CHECK_THAT(fault(4 + 8, part), Catch::Contains("parts out of order"));
  for (const uint32_t bytes : {0u, static_cast<uint32_t>(kMostAttributeBytes) + 1, ~0u})
    CHECK_THAT(fault(8, bytes), Catch::Contains("the attributes of part 1 have"));
  CHECK_THAT(fault(8, 12), Catch::Contains("another size than its entries state"));
  CHECK_THAT(fault(4 + 3 * 8, 0x5B5B5B5Bu), Catch::Contains("the attributes of part 1 are not an object"));
}

TEST_CASE("Attributes are objects of JSON within limits", "[parts]") {
  const auto nested = [](int levels) {
    std::string text = R"({"a":)";
    for (int i = 1; i < levels; ++i) text += '[';
    text += '7';
    for (int i = 1; i < levels; ++i) text += ']';
    return levels == 1 ? std::string(R"({"a":1})") : text + '}';
  };
  for (int levels : {1, 2, kMostAttributeLevels}) CHECK(IsAttributes(nested(levels)));
  for (int levels : {kMostAttributeLevels + 1, 1000, 8000}) CHECK_FALSE(IsAttributes(nested(levels)));
  for (const char* other : {"", "{}", "[1]", "1", "{", R"({"a":})", R"({"a":1} x)", "{\"a\":\"\xFF\"}"})
    CHECK_FALSE(IsAttributes(other));
  CHECK(IsAttributes(R"({"a":")" + std::string(kMostAttributeBytes - 8, 'x') + R"("})"));
  CHECK_FALSE(IsAttributes(R"({"a":")" + std::string(kMostAttributeBytes - 7, 'x') + R"("})"));
}

}  // namespace quarry

#include "preprocess/spill_sink.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>

namespace quarry {
namespace {

constexpr uint32_t kRed = 0xFF0000FFu;

/// A file of `count` triangles side by side, from x = `from` on.
void AddFile(SpillSink& sink, uint32_t count, double from, bool colored, bool normals) {
  REQUIRE(sink.BeginFile("f"));
  for (uint32_t i = 0; i < count; ++i) {
    const double x = from + i;
    for (const glm::dvec3& p : {glm::dvec3(x, 0, 0), glm::dvec3(x + 1, 0, 0), glm::dvec3(x, 1, 0)})
      REQUIRE(sink.AddPosition(p, colored ? Rgba8{255, 0, 0, 255} : Rgba8{}));
    Corner corners[3];
    for (uint32_t k = 0; k < 3; ++k) corners[k] = {3 * i + k, normals ? 0 : kNoIndex, kNoIndex};
    REQUIRE(sink.AddPolygon(corners, kNoIndex, kNoIndex));
  }
  if (normals) REQUIRE(sink.AddNormal({0, 0, 1}));
  REQUIRE(sink.EndFile());
}

std::vector<TriangleRecord> Records(const ImportedScene& scene) {
  std::vector<TriangleRecord> all;
  SpillReader reader(*scene.triangles);
  while (const std::byte* bytes = reader.Next()) {
    TriangleRecord record;
    std::memcpy(&record, bytes, scene.triangles->element_bytes());
    all.push_back(record);
  }
  REQUIRE(reader.status());
  return all;
}

SpillSink MakeSink(uint64_t memory) {
  return SpillSink(std::filesystem::temp_directory_path().string(), memory, 1, [](const std::string&) {});
}

}  // namespace

TEST_CASE("Triangles are spilled without shading until a file has some") {
  // Little memory: indices are resolved in several passes.
  for (uint64_t memory : {uint64_t{1} << 20, uint64_t{1} << 30}) {
    constexpr uint32_t kCount = 40000;
    SpillSink sink = MakeSink(memory);
    AddFile(sink, kCount, 0, false, false);
    AddFile(sink, 10, 1e4, true, false);
    AddFile(sink, 10, 2e4, false, true);
    const auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    CHECK(scene->has_shading);
    CHECK(scene->triangles->element_bytes() == sizeof(TriangleRecord));
    const std::vector<TriangleRecord> records = Records(*scene);
    REQUIRE(records.size() == kCount + 20);
    for (uint32_t i = 0; i < records.size(); ++i) REQUIRE(records[i].id == i);
    CHECK(records[kCount - 1].vertices[1].x == static_cast<float>(kCount));
    CHECK(records[kCount - 1].shading[2].color == 0xFFFFFFFFu);
    CHECK(records[kCount].shading[0].color == kRed);
    CHECK(records[kCount].shading[0].normal == glm::vec3(0));
    CHECK(records[kCount + 10].shading[1].normal == glm::vec3(0, 0, 1));
  }
  SpillSink plain = MakeSink(1 << 20);
  AddFile(plain, 40000, 0, false, false);
  AddFile(plain, 5, 0, false, false);
  const auto scene = plain.Finish();
  REQUIRE(scene.has_value());
  CHECK_FALSE(scene->has_shading);
  CHECK(scene->triangles->element_bytes() == 48);
  CHECK(Records(*scene).size() == 40005);
}

TEST_CASE("A model far from the origin is brought near it, by whole steps") {
  SpillSink sink = MakeSink(1 << 20);
  AddFile(sink, 3, 500736.25, false, false);
  const auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  CHECK(scene->offset == glm::dvec3(500736, 0, 0));
  CHECK(Records(*scene)[0].vertices[0] == glm::vec3(0.25f, 0, 0));
  SpillSink near = MakeSink(1 << 20);
  AddFile(near, 3, 16383, false, false);
  CHECK(near.Finish()->offset == glm::dvec3(0));
}

}  // namespace quarry

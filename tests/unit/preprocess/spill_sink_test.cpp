#include "preprocess/ingest/spill_sink.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <random>
#include <set>

#include "preprocess/import/importer.h"
#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

using test::TemporaryFolder;

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

SpillSink MakeSink(const TemporaryFolder& folder, uint64_t memory, unsigned threads = 2) {
  return SpillSink(
      folder.path(), memory, 1, [](const std::string&) {}, true, {}, threads);
}

}  // namespace

TEST_CASE("A concave polygon is split alike whether its vertices come before or after it") {
  const glm::dvec3 corners[] = {{2, 0, 0}, {2, 1, 0}, {1, 1, 0}, {1, 2, 0}, {0, 2, 0}, {0, 0, 0}};
  std::vector<TriangleRecord> records[2];
  for (const bool faces_first : {false, true}) {
    const TemporaryFolder folder;
    SpillSink sink = MakeSink(folder, 1 << 20);
    const auto faces = [&] {
      REQUIRE(sink.SetFaceColor({255, 0, 0, 255}));
      Corner ring[6];
      for (uint32_t k = 0; k < 6; ++k) ring[k].position = k;
      REQUIRE(sink.AddPolygon(ring, kNoIndex, kNoIndex));
      REQUIRE(sink.SetFaceColor({}));
      REQUIRE(sink.AddPolygon(std::span(ring).last(3), kNoIndex, kNoIndex));
    };
    REQUIRE(sink.BeginFile("f"));
    if (faces_first) faces();
    for (const glm::dvec3& p : corners) REQUIRE(sink.AddPosition(p, Rgba8{}));
    if (!faces_first) faces();
    REQUIRE(sink.EndFile());
    const auto scene = sink.Finish();
    REQUIRE(scene);
    CHECK(scene->input_triangles == 5);
    records[faces_first] = Records(*scene);
  }
  REQUIRE(records[0].size() == 5);
  double area = 0;
  for (size_t i = 0; i < 5; ++i) {
    const TriangleRecord &a = records[0][i], &b = records[1][i];
    CHECK(a.id == i);
    CHECK(a.colors[0] == (i < 4 ? kRed : 0xFFFFFFFFu));
    for (int k = 0; k < 3; ++k) CHECK(a.vertices[k] == b.vertices[k]);
    if (i < 4)
      area += glm::length(glm::cross(a.vertices[1] - a.vertices[0], a.vertices[2] - a.vertices[0])) / 2;
  }
  CHECK(area == Approx(3));
}

TEST_CASE("Triangles are spilled without shading until a file has some") {
  // Little memory: indices are resolved in several passes.
  for (uint64_t memory : {uint64_t{1} << 20, uint64_t{1} << 30}) {
    constexpr uint32_t kCount = 40000;
    const TemporaryFolder folder;
    SpillSink sink = MakeSink(folder, memory);
    AddFile(sink, kCount, 0, false, false);
    AddFile(sink, 10, 1e4, true, false);
    AddFile(sink, 10, 2e4, false, true);
    const auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    CHECK(scene->attributes == Attributes::kNormals);
    CHECK(scene->triangles->element_bytes() == sizeof(TriangleRecord) - 24);
    const std::vector<TriangleRecord> records = Records(*scene);
    REQUIRE(records.size() == kCount + 20);
    for (uint32_t i = 0; i < records.size(); ++i) REQUIRE(records[i].id == i);
    CHECK(records[kCount - 1].vertices[1].x == static_cast<float>(kCount));
    CHECK(records[kCount - 1].colors[2] == 0xFFFFFFFFu);
    CHECK(records[kCount].colors[0] == kRed);
    CHECK(records[kCount].normals[0] == glm::vec3(0));
    CHECK(records[kCount + 10].normals[1] == glm::vec3(0, 0, 1));
  }
  const TemporaryFolder folder;
  SpillSink plain = MakeSink(folder, 1 << 20);
  AddFile(plain, 40000, 0, false, false);
  AddFile(plain, 5, 0, false, false);
  const auto scene = plain.Finish();
  REQUIRE(scene.has_value());
  CHECK(scene->attributes == Attributes::kNone);
  CHECK(scene->triangles->element_bytes() == 48);
  CHECK(Records(*scene).size() == 40005);
}

TEST_CASE("A model far from the origin is moved near it, by whole steps") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  AddFile(sink, 3, 500736.25, false, false);
  const auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  CHECK(scene->offset == glm::dvec3(500736, 0, 0));
  CHECK(Records(*scene)[0].vertices[0] == glm::vec3(0.25f, 0, 0));
  SpillSink near = MakeSink(folder, 1 << 20);
  AddFile(near, 3, 16383, false, false);
  CHECK(near.Finish()->offset == glm::dvec3(0));
}

TEST_CASE("Triangles whose vertices lie far apart in the file, or come later, are the same in the end",
          "[long]") {
  // More vertices than pages hold; every triangle's corners come from three places, in no order.
  constexpr uint32_t kVertices = 3 << 20, kFaces = 200000;
  const auto position = [](uint32_t i) { return glm::dvec3(i % 1024, i / 1024 % 1024, i / (1024 * 1024)); };
  const auto corner = [](uint32_t face, uint32_t k) {
    return (face * 2654435761u + k * 40503u * 97u) % kVertices;
  };
  std::vector<TriangleRecord> vertices_first;
  struct Run {
    uint64_t memory;
    bool faces_first;
    unsigned threads;
  };
  const Run runs[] = {{1 << 20, false, 2}, {1 << 20, true, 2}, {1 << 28, false, 5}, {1 << 28, true, 5}};
  for (const auto [memory, faces_first, threads] : runs) {
    const TemporaryFolder folder;
    SpillSink sink = MakeSink(folder, memory, threads);
    REQUIRE(sink.BeginFile("f"));
    const auto vertices = [&] {
      for (uint32_t i = 0; i < kVertices; ++i) REQUIRE(sink.AddPosition(position(i), Rgba8{}));
    };
    if (!faces_first) vertices();
    for (uint32_t f = 0; f < kFaces; ++f) {
      Corner corners[3];
      for (uint32_t k = 0; k < 3; ++k) corners[k].position = corner(f, k);
      REQUIRE(sink.AddPolygon(corners, kNoIndex, kNoIndex));
    }
    if (faces_first) vertices();
    REQUIRE(sink.EndFile());
    const auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    std::vector<TriangleRecord> records = Records(*scene);
    REQUIRE(records.size() + scene->dropped_degenerate == kFaces);
    size_t wrong = 0;
    for (const TriangleRecord& r : records)
      for (uint32_t k = 0; k < 3; ++k) wrong += r.vertices[k] != glm::vec3(position(corner(r.id, k)));
    CHECK(wrong == 0);
    if (faces_first) continue;
    // Their order too depends on the file alone.
    if (vertices_first.empty()) vertices_first = records;
    size_t moved = 0;
    for (size_t i = 0; i < records.size(); ++i) moved += records[i].id != vertices_first[i].id;
    CHECK(moved == 0);
  }
}

TEST_CASE("A preview changes nothing of what is imported") {
  // Every triangle's corners come from three places: pages are loaded, and faces wait, batch by batch.
  constexpr uint32_t kVertices = 1200 << 10, kFaces = 60000;
  std::vector<uint32_t> ids[2];
  for (const bool previews : {false, true}) {
    const TemporaryFolder folder;
    ::setenv("QUARRY_PROGRESS_FILE", folder.file("progress").c_str(), 1);
    std::optional<PreviewFile> preview = PreviewFile::Wanted(0, 0);
    ::unsetenv("QUARRY_PROGRESS_FILE");
    if (!previews) preview.reset();
    SpillSink sink(
        folder.path(), 1 << 20, 1, [](const std::string&) {}, true, std::move(preview));
    REQUIRE(sink.BeginFile("f"));
    size_t failed = 0;
    for (uint32_t i = 0; i < kVertices; ++i)
      failed += !sink.AddPosition(glm::dvec3(i % 1024, i / 1024, i % 7), Rgba8{});
    for (uint32_t f = 0; f < kFaces; ++f) {
      Corner corners[3];
      for (uint32_t k = 0; k < 3; ++k) corners[k].position = (f * 2654435761u + k * 3928591u) % kVertices;
      failed += !sink.AddPolygon(corners, kNoIndex, kNoIndex);
    }
    REQUIRE(failed == 0);
    REQUIRE(sink.EndFile());
    const auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    CHECK(std::filesystem::exists(folder.file("progress.discs")) == previews);
    for (const TriangleRecord& record : Records(*scene)) ids[previews].push_back(record.id);
  }
  CHECK(ids[0].size() > kFaces / 2);
  CHECK(!std::ranges::is_sorted(ids[0]));
  CHECK(ids[0] == ids[1]);
}

TEST_CASE("A closed sheet in an STL is judged alike by any number of threads") {
  // Its volume is 0 but for rounding, so its sign depends on the order of the sum.
  std::vector<std::array<glm::vec3, 3>> facets;
  const auto point = [](int i, int j) {
    return glm::vec3(static_cast<float>(i) + 0.1f * static_cast<float>(i * j % 3), static_cast<float>(j),
                     static_cast<float>((i * 37 + j * 11) % 10) / 7);
  };
  for (int i = 0; i < 160; ++i)
    for (int j = 0; j < 160; ++j)
      for (const auto& [a, b, c] : {std::array{point(i, j), point(i + 1, j), point(i + 1, j + 1)},
                                    std::array{point(i, j), point(i + 1, j + 1), point(i, j + 1)}}) {
        facets.push_back({a, b, c});
        facets.push_back({c, b, a});
      }
  std::shuffle(facets.begin(), facets.end(), std::mt19937(3));
  std::string stl(80, ' ');
  const auto put = [&](const auto& value) {
    stl.append(reinterpret_cast<const char*>(&value), sizeof value);
  };
  put(static_cast<uint32_t>(facets.size()));
  for (const auto& corners : facets) {
    put(glm::vec3(0));
    for (const glm::vec3& corner : corners) put(corner);
    put(uint16_t{0});
  }
  std::vector<ScenePart> facts[3];
  for (size_t i = 0; i < 3; ++i) {
    const TemporaryFolder folder;
    SpillSink sink = MakeSink(folder, 1 << 28, std::array{2u, 4u, 9u}[i]);
    REQUIRE(ImportModel(folder.Write("sheet.stl", stl), sink));
    const auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    facts[i] = scene->parts.facts;
  }
  REQUIRE(facts[0].size() == 1);
  CHECK((facts[0][0].flags & ScenePart::kClosed) != 0);
  CHECK((facts[0] == facts[1] && facts[0] == facts[2]));
}

TEST_CASE("Another process takes over a saved import") {
  const TemporaryFolder folder;
  Bytes saved;
  {
    SpillSink sink = MakeSink(folder, 1 << 20);
    sink.AddMaterial({.name = "steel", .diffuse = {0.1f, 0.2f, 0.3f}, .ior = 1.5f, .fresnel = true});
    AddFile(sink, 1000, 500736.25, true, false);
    AddFile(sink, 10, 500000, false, false);
    auto state = sink.Save();
    REQUIRE(state.has_value());
    saved = *state;
  }
  SpillSink sink = MakeSink(folder, 1 << 20);
  REQUIRE(sink.Restore(saved, false));
  const auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  CHECK(scene->attributes == Attributes::kColors);
  CHECK(scene->offset == glm::dvec3(500736, 0, 0));
  CHECK(scene->input_triangles == 1010);
  CHECK(scene->materials[0] ==
        Material{.name = "steel", .diffuse = {0.1f, 0.2f, 0.3f}, .ior = 1.5f, .fresnel = true});
  CHECK(scene->parts.names == std::vector<std::string>{"f", "f"});
  const std::vector<TriangleRecord> records = Records(*scene);
  REQUIRE(records.size() == 1010);
  for (uint32_t i = 0; i < records.size(); ++i) REQUIRE(records[i].id == i);
  CHECK(records[1005].vertices[0].x == 500005 - 500736);
}

namespace {

/// A file with a triangle of each part that `add` returns.
template <class Add>
void AddParts(SpillSink& sink, const std::string& name, Add&& add) {
  REQUIRE(sink.BeginFile(name));
  for (const glm::dvec3& p : {glm::dvec3(0), glm::dvec3(1, 0, 0), glm::dvec3(0, 1, 0)})
    REQUIRE(sink.AddPosition(p, Rgba8{}));
  for (const uint32_t part : std::vector<uint32_t>(add())) {
    const Corner corners[3] = {{0}, {1}, {2}};
    REQUIRE(sink.AddPolygon(corners, kNoIndex, part));
  }
  REQUIRE(sink.EndFile());
}

/// The path and the triangles of each part.
std::vector<std::string> PathsOf(const PartTable& parts) {
  std::vector<std::string> paths;
  for (size_t i = 0; i < parts.names.size(); ++i) {
    const uint32_t parent = parts.facts[i].parent;
    REQUIRE((parent == ScenePart::kNoParent || parent < i));
    paths.push_back((parent == ScenePart::kNoParent ? "" : paths[parent] + "/") + parts.names[i]);
  }
  for (size_t i = 0; i < paths.size(); ++i) paths[i] += " " + std::to_string(parts.facts[i].triangles);
  return paths;
}

using Texts = std::vector<std::string>;

}  // namespace

TEST_CASE("Parts of one name are one, siblings stay apart", "[parts]") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  AddParts(sink, "f", [&] {
    const uint32_t hall = sink.AddPart("hall", kNoIndex), valve = sink.AddPart("valve", hall);
    CHECK(sink.AddPart("valve", hall) == valve);
    const uint32_t second = sink.AddSibling("valve", hall), third = sink.AddSibling("valve", hall);
    const uint32_t other = sink.AddSibling("valve", kNoIndex);
    sink.AddPart("pump #2", hall);
    return std::vector{
        valve,   valve, second, third, other, sink.AddSibling("pump", hall), sink.AddSibling("pump", hall),
        kNoIndex};
  });
  const auto scene = sink.Finish();
  REQUIRE(scene);
  CHECK(PathsOf(scene->parts) == Texts{"hall 0", "hall/valve 2", "hall/valve #2 1", "hall/valve #3 1",
                                       "valve 1", "hall/pump #2 0", "hall/pump 1", "hall/pump #3 1", "f 1"});
  CHECK(scene->parts.facts[1].upper == glm::vec3(1, 1, 0));
}

TEST_CASE("Several files are the roots of their parts", "[parts]") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  sink.KeepFilesApart();
  for (const char* name : {"a.ply", "b.ply", "a.ply"})
    AddParts(sink, name, [&] { return std::vector{sink.AddPart("valve", kNoIndex), kNoIndex}; });
  const auto scene = sink.Finish();
  REQUIRE(scene);
  CHECK(PathsOf(scene->parts) ==
        Texts{"a.ply 1", "a.ply/valve 1", "b.ply 1", "b.ply/valve 1", "a.ply #2 1", "a.ply #2/valve 1"});
}

TEST_CASE("Parts that would lie too deep are put beside their parents", "[parts]") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  AddParts(sink, "f", [&] {
    uint32_t part = kNoIndex;
    for (uint32_t i = 0; i < kMostPartLevels + 10; ++i) part = sink.AddSibling("level", part);
    return std::vector{part};
  });
  const auto scene = sink.Finish();
  REQUIRE(scene);
  const std::vector<ScenePart>& parts = scene->parts.facts;
  REQUIRE(parts.size() == kMostPartLevels + 10);
  CHECK(parts.back().parent == kMostPartLevels - 2);
  CHECK(scene->parts.names.back() == "level #11");
}

TEST_CASE("A saved import is refused when its files are gone or damaged") {
  const TemporaryFolder folder;
  const auto file = [&](const char* name) { return folder.path() + "/" + name; };
  Bytes saved;
  {
    SpillSink sink = MakeSink(folder, 1 << 20);
    AddFile(sink, 1000, 0, true, false);
    auto state = sink.Save();
    REQUIRE(state.has_value());
    saved = *state;
  }
  std::set<std::string> left;
  for (const auto& entry : std::filesystem::directory_iterator(folder.path()))
    left.insert(entry.path().filename().string());
  CHECK(left == std::set<std::string>{"import-state", "triangles-1"});

  const auto refused = [&](std::span<const std::byte> state) {
    SpillSink sink = MakeSink(folder, 1 << 20);
    const Status status = sink.Restore(state, false);
    return !status && status.error().message.find("start again without --resume") != std::string::npos;
  };
  CHECK_FALSE(refused(saved));
  CHECK(refused(std::span(saved).first(saved.size() - 1)));
  std::filesystem::rename(file("triangles-1"), file("elsewhere"));
  CHECK(refused(saved));
  std::filesystem::rename(file("elsewhere"), file("triangles-1"));
  std::filesystem::resize_file(file("import-state"), 100);
  CHECK(refused(saved));
  std::filesystem::remove(file("import-state"));
  CHECK(refused(saved));
}

TEST_CASE("A model is scaled, turned and moved to its place") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  AddFile(sink, 1, 0, false, false);
  sink.Place({2, 90, {10, 20, 30}}, 2);
  AddFile(sink, 1, 0, false, true);
  sink.Place({1, 90, {0, 0, 0}}, 1);
  AddFile(sink, 1, 0, false, true);
  const auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  const auto records = Records(*scene);
  const auto close = [](const glm::vec3& a, const glm::vec3& b) { return glm::length(a - b) < 1e-5f; };
  CHECK(close(records[0].vertices[1], {1, 0, 0}));
  CHECK(close(records[1].vertices[0], {10, 20, 30}));
  CHECK(close(records[1].vertices[1], {10, 22, 30}));
  CHECK(close(records[1].vertices[2], {8, 20, 30}));
  CHECK(close(records[2].vertices[1], {0, 0, -1}));  // x turns to -z about y
  CHECK(close(records[2].vertices[2], {0, 1, 0}));
  CHECK(close(records[2].normals[0], {1, 0, 0}));
}

TEST_CASE("A material's length is scaled with its model") {
  const TemporaryFolder folder;
  SpillSink sink = MakeSink(folder, 1 << 20);
  Material glass{"glass"};
  glass.transmission_depth = 3;
  sink.AddMaterial(glass);
  sink.Place({2, 90, {10, 20, 30}}, 2);
  sink.AddMaterial(glass);
  AddFile(sink, 1, 0, false, false);
  const auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  REQUIRE(scene->materials.size() == 3);  // and the triangle's
  CHECK(scene->materials[0].transmission_depth == 3);
  CHECK(scene->materials[1].transmission_depth == 6);
}

}  // namespace quarry

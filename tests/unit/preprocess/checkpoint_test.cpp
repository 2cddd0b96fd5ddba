// Imports killed at every checkpoint give the results of an undisturbed import.

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "common/base/file.h"
#include "preprocess/import/importer.h"
#include "preprocess/ingest/spill_sink.h"
#include "preprocess/spill/paged_file.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/three_mf_builder.h"

namespace quarry {
namespace {

constexpr uint32_t kSide = 110;  // vertices along one side of a grid: enough for several look-ups of a sink

uint32_t At(uint32_t x, uint32_t y) { return y * kSide + x; }

/// The grid's triangles, each with a few thousand others between its vertices' first use and its own.
template <class Use>
void ForEachTriangle(Use&& use) {
  for (uint32_t y = 0; y + 1 < kSide; ++y)
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      use(At(x, y), At(x + 1, y), At(x + 1, y + 1));
      use(At(x, y), At(x + 1, y + 1), At(x, y + 1));
    }
}
constexpr uint32_t kTriangles = 2 * (kSide - 1) * (kSide - 1);

glm::vec3 Position(uint32_t vertex) {
  const auto x = static_cast<float>(vertex % kSide), y = static_cast<float>(vertex / kSide);
  return {x, y, static_cast<float>(vertex * 2654435761u % 97) / 64.0f};
}

template <class T>
void Put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

void Write(const std::string& path, const std::string& text) {
  REQUIRE(WriteFileAtomically(path, AsBytes(text)));
}

std::string PlyHeader(const char* format) {
  return fmt::format(
      "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\n"
      "property list uchar int vertex_indices\nproperty int material_index\nproperty int part_index\n"
      "end_header\n",
      format, kSide * kSide, kTriangles);
}

void WritePly(const std::string& path, bool binary) {
  std::string ply = PlyHeader(binary ? "binary_little_endian" : "ascii");
  for (uint32_t v = 0; v < kSide * kSide; ++v) {
    const glm::vec3 p = Position(v);
    const auto red = static_cast<uint8_t>(v);
    if (binary) {
      Put(ply, p);
      for (const uint8_t c : {red, uint8_t{7}, uint8_t{9}}) Put(ply, c);
    } else {
      ply += fmt::format("{} {} {} {} 7 9\n", p.x, p.y, p.z, red);
    }
  }
  uint32_t face = 0;
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) {
    const uint32_t material = face++ % 2, part = face % 3;
    if (binary) {
      Put(ply, uint8_t{3});
      for (const uint32_t i : {a, b, c, material, part}) Put(ply, i);
    } else {
      ply += fmt::format("3 {} {} {} {} {}\n", a, b, c, material, part);
    }
  });
  Write(path, ply);
  Write(path.substr(0, path.size() - 4) + ".materials.json",
        R"({"materials": [{"name": "a"}, {"name": "b"}], "parts": ["p", "q", "r"]})");
}

void WriteStl(const std::string& path, bool binary) {
  std::string stl = binary ? std::string(80, 'x') : "solid grid\n";
  if (binary) Put(stl, kTriangles);
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) {
    if (binary) Put(stl, glm::vec3(0));
    if (!binary) stl += "facet normal 0 0 1\nouter loop\n";
    for (const uint32_t v : {a, b, c}) {
      const glm::vec3 p = Position(v);
      if (binary)
        Put(stl, p);
      else
        stl += fmt::format("vertex {} {} {}\n", p.x, p.y, p.z);
    }
    if (binary) Put(stl, uint16_t{0});
    if (!binary) stl += "endloop\nendfacet\n";
  });
  Write(path, stl);
}

void WriteOff(const std::string& path) {
  std::string off = fmt::format("OFF\n{} {} 0\n", kSide * kSide, kTriangles);
  for (uint32_t v = 0; v < kSide * kSide; ++v)
    off += fmt::format("{} {} {}\n", Position(v).x, Position(v).y, Position(v).z);
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) { off += fmt::format("3 {} {} {}\n", a, b, c); });
  Write(path, off);
}

/// With all that an OBJ's reader must remember: two libraries, of which the first that names a material has
/// its say; a material that no library has; groups within objects; normals that come later, or never; indices
/// from the end; faces of two corners.
void WriteObj(const std::string& path) {
  std::string obj = "mtllib a.mtl\nmtllib b.mtl\nmtllib missing.mtl\n";
  for (uint32_t v = 0; v < kSide * kSide; ++v)
    obj += fmt::format("v {} {} {}\nvt {} 0.5\n", Position(v).x, Position(v).y, Position(v).z, v % 16 / 16.0);
  uint32_t face = 0;
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) {
    if (face % 3000 == 0) obj += fmt::format("o object{}\n", face / 6000);
    if (face % 2000 == 0) obj += fmt::format("g group{}\n", face / 2000 % 3);
    if (face % 1500 == 0) obj += fmt::format("usemtl m{}\n", face / 1500 % 4);
    if (face % 1700 == 0) obj += face % 3400 == 0 ? "s off\n" : fmt::format("s {}\n", face);
    if (face % 5000 == 1) obj += "f 1 2\nvn 0 0 1\n";
    const int64_t end = -int64_t{kSide * kSide};
    if (face % 2 == 0)
      obj += fmt::format("f {0}/{0} {1}/{1} {2}/{2}\n", a + 1, b + 1, c + 1);
    else
      obj += fmt::format("f {}//{} {}//9999999 {}\n", end + a, face % 3 + 1, end + b, end + c);
    ++face;
  });
  Write(path, obj);
  const std::string folder = std::filesystem::path(path).parent_path().string();
  Write(folder + "/a.mtl", "newmtl m0\nKd 1 0 0\nnewmtl m1\nKd 0 1 0\n");
  Write(folder + "/b.mtl", "newmtl m1\nKd 0 0 1\nnewmtl m2\nKd 1 1 0\nNonsense\n");
}

/// Each of six nodes has a mesh of two primitives.
void WriteGltf(const std::string& path) {
  std::string buffer;
  for (uint32_t v = 0; v < kSide * kSide; ++v) Put(buffer, Position(v));
  const size_t positions = buffer.size();
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) {
    for (const uint32_t i : {a, b, c}) Put(buffer, i);
  });
  nlohmann::json gltf = {
      {"asset", {{"version", "2.0"}}},
      {"buffers", {{{"uri", "grid.bin"}, {"byteLength", buffer.size()}}}},
      {"bufferViews",
       {{{"buffer", 0}, {"byteLength", positions}},
        {{"buffer", 0}, {"byteOffset", positions}, {"byteLength", buffer.size() - positions}}}},
      {"accessors",
       {{{"bufferView", 0}, {"componentType", 5126}, {"count", kSide * kSide}, {"type", "VEC3"}},
        {{"bufferView", 1}, {"componentType", 5125}, {"count", 3 * kTriangles}, {"type", "SCALAR"}}}},
      {"materials", {{{"name", "a"}}, {{"name", "b"}}}},
      {"meshes",
       {{{"primitives",
          {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"material", 0}},
           {{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"material", 1}}}}}}}};
  for (int i = 0; i < 6; ++i)
    gltf["nodes"].push_back(
        {{"mesh", 0}, {"name", fmt::format("node{}", i / 2)}, {"translation", {i, 0, 100 * i}}});
  Write(path, gltf.dump());
  Write(std::filesystem::path(path).parent_path().string() + "/grid.bin", buffer);
}

/// Each of six objects has a look of its own; some are shown twice.
void WriteThreeMf(const std::string& path) {
  std::string mesh = "<mesh><vertices>";
  for (uint32_t v = 0; v < kSide * kSide; ++v)
    mesh += fmt::format("<vertex x=\"{}\" y=\"{}\" z=\"{}\"/>", Position(v).x, Position(v).y, Position(v).z);
  mesh += "</vertices><triangles>";
  ForEachTriangle([&](uint32_t a, uint32_t b, uint32_t c) {
    mesh += fmt::format("<triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>", a, b, c);
  });
  mesh += "</triangles></mesh>";
  std::string objects =
      "<basematerials id=\"90\"><base name=\"a\" displaycolor=\"#ff0000\"/><base name=\"b\" "
      "displaycolor=\"#00ff00\"/></basematerials><m:colorgroup id=\"91\"><m:color color=\"#0000ff\"/>"
      "</m:colorgroup>";
  std::string build;
  for (int i = 1; i <= 6; ++i) {
    objects += ThreeMfObject(i, mesh,
                             fmt::format("name=\"n{}\" pid=\"{}\" pindex=\"{}\"", i / 2, 90 + i % 2, i % 3));
    for (int shown = 0; shown < 1 + i % 2; ++shown)
      build += Item(i, Moved(fmt::format("{} 0 {}", 200 * shown, 100 * i)));
  }
  Write(path, Zip(ThreeMfParts(ThreeMfModel(objects, build))));
}

/// The records and counts from which a store is made.
struct Outcome {
  std::vector<std::string> records, parts, warnings;
  std::vector<Material> materials;
  std::vector<KdTriangle> sample;
  std::vector<uint64_t> counts;
  Box bounds{};
};

Outcome OutcomeOf(ImportedScene scene) {
  Outcome outcome;
  SpillReader reader(*scene.triangles);
  while (const std::byte* bytes = reader.Next())
    outcome.records.emplace_back(reinterpret_cast<const char*>(bytes), scene.triangles->element_bytes());
  REQUIRE(reader.status());
  outcome.parts = scene.parts;
  outcome.warnings = scene.warnings;
  outcome.materials = scene.materials;
  outcome.counts = {scene.input_triangles, scene.dropped_degenerate, scene.dropped_not_finite,
                    scene.sample.weight()};
  outcome.bounds = scene.bounds;
  outcome.sample = scene.sample.TakeTriangles();
  return outcome;
}

void MustBeTheSame(const Outcome& a, const Outcome& b) {
  CHECK((a.records == b.records));
  CHECK(a.parts == b.parts);
  CHECK(a.warnings == b.warnings);
  CHECK((a.materials == b.materials));
  REQUIRE(a.sample.size() == b.sample.size());
  CHECK(std::memcmp(a.sample.data(), b.sample.data(), a.sample.size() * sizeof(KdTriangle)) == 0);
  CHECK(a.counts == b.counts);
  CHECK(a.bounds.lower == b.bounds.lower);
  CHECK(a.bounds.upper == b.bounds.upper);
}

constexpr uint64_t kMemory = 64ull << 20;

SpillSink MakeSink(const std::string& folder) {
  return SpillSink(folder, kMemory, 1, [](const std::string&) {});
}

template <class Give>
Outcome Undisturbed(Give&& give) {
  const test::TemporaryFolder folder;
  SpillSink sink = MakeSink(folder.path());
  REQUIRE(give(sink));
  auto scene = sink.Finish();
  REQUIRE(scene.has_value());
  return OutcomeOf(std::move(*scene));
}

/// Every process makes one checkpoint and dies at the next, with its sink's unwritten buffers. One more
/// process dies after the last checkpoint, where a checkpoint between files would be.
template <class Give>
Outcome KilledAtEveryCheckpoint(Give&& give, size_t& kills) {
  const test::TemporaryFolder folder;
  Bytes saved;
  bool died_at_end = false;
  for (kills = 0;; ++kills) {
    REQUIRE(kills < 1000);
    SpillSink sink = MakeSink(folder.path());
    if (!saved.empty()) REQUIRE(sink.Restore(saved, false));
    bool saved_once = false;
    sink.CheckpointEvery(0, [&]() -> Status {
      if (std::exchange(saved_once, true)) return Fail("killed");
      QUARRY_ASSIGN(saved, sink.Save());
      sink.Committed();
      return {};
    });
    const Status given = give(sink);
    if (!given) {
      REQUIRE(given.error().message == "killed");
      continue;
    }
    if (!std::exchange(died_at_end, true)) continue;
    auto scene = sink.Finish();
    REQUIRE(scene.has_value());
    return OutcomeOf(std::move(*scene));
  }
}

void MustGoOn(const std::string& path, size_t least_kills) {
  INFO(path);
  const auto give = [&](SpillSink& sink) { return ImportModel(path, sink); };
  const Outcome whole = Undisturbed(give);
  size_t kills = 0;
  const Outcome pieces = KilledAtEveryCheckpoint(give, kills);
  CHECK(kills >= least_kills);
  MustBeTheSame(pieces, whole);
}

}  // namespace

TEST_CASE("Imports of every format go on from every checkpoint", "[import][resume][long]") {
  const test::TemporaryFolder folder;
  for (const bool binary : {true, false}) {
    const std::string name = binary ? "binary" : "text";
    WritePly(folder.file(name + ".ply"), binary);
    MustGoOn(folder.file(name + ".ply"), 5);
    WriteStl(folder.file(name + ".stl"), binary);
    MustGoOn(folder.file(name + ".stl"), 10);
  }
  WriteOff(folder.file("x.off"));
  MustGoOn(folder.file("x.off"), 5);
  WriteObj(folder.file("x.obj"));
  MustGoOn(folder.file("x.obj"), 6);
  WriteGltf(folder.file("x.gltf"));
  MustGoOn(folder.file("x.gltf"), 11);
  WriteThreeMf(folder.file("x.3mf"));
  MustGoOn(folder.file("x.3mf"), 6);
}

TEST_CASE("A checkpoint does not go on with another material library, or other buffers", "[import][resume]") {
  const auto refusal = [](const std::string& model, const std::string& part, const std::string& changed) {
    const test::TemporaryFolder work;
    Bytes saved;
    {
      SpillSink sink = MakeSink(work.path());
      sink.CheckpointEvery(0, [&]() -> Status {
        QUARRY_ASSIGN(saved, sink.Save());
        return Fail("killed");
      });
      REQUIRE_FALSE(ImportModel(model, sink).has_value());
    }
    Write(part, changed);
    SpillSink sink = MakeSink(work.path());
    REQUIRE(sink.Restore(saved, false));
    const Status status = ImportModel(model, sink);
    REQUIRE_FALSE(status.has_value());
    return status.error().message;
  };
  const test::TemporaryFolder folder;
  WriteObj(folder.file("x.obj"));
  CHECK(refusal(folder.file("x.obj"), folder.file("b.mtl"), "newmtl m2\n").find("b.mtl: has changed since") !=
        std::string::npos);
  WriteGltf(folder.file("x.gltf"));
  CHECK(refusal(folder.file("x.gltf"), folder.file("grid.bin"), std::string(1 << 20, 'x'))
            .find("x.gltf: a file of its buffers has changed since") != std::string::npos);
}

TEST_CASE("The pages in memory, and what may still be loaded, are the same after a kill",
          "[import][resume]") {
  // More vertices than pages hold, and faces of which some are near, some far: whether one waits, and with
  // that the order of triangles, depends on which pages are there.
  constexpr uint32_t kVertices = 300 * PagedFile::kPageElements, kFaces = 60000;
  const auto give = [&](SpillSink& sink) -> Status {
    QUARRY_TRY(sink.BeginFile("f"));
    uint32_t vertex = 0, face = 0;
    if (!sink.LastCheckpoint().empty()) {
      ByteReader in(sink.LastCheckpoint());
      vertex = in.Get<uint32_t>();
      face = in.Get<uint32_t>();
    }
    const auto look = [&]() -> Status {
      if (vertex < kVertices / 2 || !sink.CheckpointDue()) return {};
      ByteWriter out;
      out.Put(vertex);
      out.Put(face);
      return sink.Checkpoint(out.Take());
    };
    for (; vertex < kVertices; ++vertex) {
      if (vertex % (1 << 18) == 0) QUARRY_TRY(look());
      QUARRY_TRY(sink.AddPosition(glm::dvec3(vertex % 1024, vertex / 1024, vertex % 7), Rgba8{}));
    }
    for (; face < kFaces; ++face) {
      if (face % 1001 == 0) QUARRY_TRY(look());  // out of step with other counts
      Corner corners[4];                         // crossing, most of them
      for (uint32_t k = 0; k < 4; ++k)
        corners[k].position = (face / 3 * 2654435761u + (face % 5 == 0 ? k * 4000037u : k)) % kVertices;
      QUARRY_TRY(sink.AddPolygon(corners, kNoIndex, kNoIndex));
    }
    return sink.EndFile();
  };
  const Outcome whole = Undisturbed(give);
  size_t kills = 0;
  const Outcome pieces = KilledAtEveryCheckpoint(give, kills);
  CHECK(kills >= 8);
  MustBeTheSame(pieces, whole);
}

TEST_CASE("Windows over faces that waited go on from the last", "[import][resume][long]") {
  // Faces before their vertices, enough of them to be worth checkpoints, in several windows.
  constexpr uint32_t kVertices = 1500000, kFaces = (1 << 20) + 1000;
  const auto give = [&](SpillSink& sink) -> Status {
    QUARRY_TRY(sink.BeginFile("f"));
    if (sink.HasAll()) return sink.EndFile();
    for (uint32_t f = 0; f < kFaces / 3; ++f) {
      Corner corners[5];
      for (uint32_t k = 0; k < 5; ++k) corners[k].position = (f * 2654435761u + k * 4000037u) % kVertices;
      QUARRY_TRY(sink.AddPolygon(corners, kNoIndex, kNoIndex));
    }
    for (uint32_t v = 0; v < kVertices; ++v)
      QUARRY_TRY(sink.AddPosition(glm::dvec3(v % 1024, v / 1024, v % 7), Rgba8{}));
    return sink.EndFile();
  };
  const Outcome whole = Undisturbed(give);
  size_t kills = 0;
  const Outcome pieces = KilledAtEveryCheckpoint(give, kills);
  CHECK(kills == 4);  // one of them behind the last
  MustBeTheSame(pieces, whole);
}

}  // namespace quarry

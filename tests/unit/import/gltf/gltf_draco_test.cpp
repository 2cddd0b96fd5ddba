#include <draco/compression/encode.h>
#include <draco/mesh/triangle_soup_mesh_builder.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <glm/geometric.hpp>

#include "common/program/installed_program.h"
#include "tests/unit/gltf_builder.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

constexpr const char* kExtension = "KHR_draco_mesh_compression";
constexpr int kSide = 20;  // cells of a grid

/// A compressed mesh and the ids of its attributes.
struct Compressed {
  std::string bytes;
  Json attributes;
};

/// A corner of the grid: a wave with normals, texture coordinates and colours.
struct GridCorner {
  std::array<float, 3> position, normal{0, 0, 1};
  std::array<float, 2> uv;
  std::array<uint8_t, 4> color;
};

GridCorner CornerAt(int x, int y) {
  const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
  return {{fx, fy, std::sin(fx * fy * 0.1f)},
          {0, 0, 1},
          {fx / kSide, fy / kSide},
          {static_cast<uint8_t>(x * 12), static_cast<uint8_t>(y * 12), 40, 255}};
}

/// `method`: of Draco; a quantisation of 0 bits keeps the floats.
Compressed Encode(int method, int bits) {
  draco::TriangleSoupMeshBuilder builder;
  builder.Start(2 * kSide * kSide);
  const int position = builder.AddAttribute(draco::GeometryAttribute::POSITION, 3, draco::DT_FLOAT32);
  const int normal = builder.AddAttribute(draco::GeometryAttribute::NORMAL, 3, draco::DT_FLOAT32);
  const int uv = builder.AddAttribute(draco::GeometryAttribute::TEX_COORD, 2, draco::DT_FLOAT32);
  const int color = builder.AddAttribute(draco::GeometryAttribute::COLOR, 4, draco::DT_UINT8, true);
  uint32_t face = 0;
  const auto add = [&](std::array<GridCorner, 3> c) {
    const draco::FaceIndex f(face++);
    builder.SetAttributeValuesForFace(position, f, &c[0].position, &c[1].position, &c[2].position);
    builder.SetAttributeValuesForFace(normal, f, &c[0].normal, &c[1].normal, &c[2].normal);
    builder.SetAttributeValuesForFace(uv, f, &c[0].uv, &c[1].uv, &c[2].uv);
    builder.SetAttributeValuesForFace(color, f, &c[0].color, &c[1].color, &c[2].color);
  };
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      add({CornerAt(x, y), CornerAt(x + 1, y), CornerAt(x + 1, y + 1)});
      add({CornerAt(x, y), CornerAt(x + 1, y + 1), CornerAt(x, y + 1)});
    }
  const std::unique_ptr<draco::Mesh> mesh = builder.Finalize();
  draco::Encoder encoder;
  encoder.SetEncodingMethod(method);
  if (bits > 0)
    for (const auto type : {draco::GeometryAttribute::POSITION, draco::GeometryAttribute::NORMAL,
                            draco::GeometryAttribute::TEX_COORD})
      encoder.SetAttributeQuantization(type, bits);
  draco::EncoderBuffer buffer;
  REQUIRE(encoder.EncodeMeshToBuffer(*mesh, &buffer).ok());
  const auto id = [&](int attribute) { return mesh->attribute(attribute)->unique_id(); };
  return {
      std::string(buffer.data(), buffer.size()),
      {{"POSITION", id(position)}, {"NORMAL", id(normal)}, {"TEXCOORD_0", id(uv)}, {"COLOR_0", id(color)}}};
}

/// A document that shows a compressed mesh twice.
Builder Document(const Compressed& mesh) {
  Builder b;
  b.buffer = mesh.bytes;
  b.json["bufferViews"] = {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", mesh.bytes.size()}}};
  const uint32_t count = (kSide + 1) * (kSide + 1);
  b.json["accessors"] = {{{"componentType", 5126}, {"count", count}, {"type", "VEC3"}},
                         {{"componentType", 5126}, {"count", count}, {"type", "VEC3"}},
                         {{"componentType", 5126}, {"count", count}, {"type", "VEC2"}},
                         {{"componentType", 5121}, {"count", count}, {"type", "VEC4"}, {"normalized", true}},
                         {{"componentType", 5123}, {"count", 6 * kSide * kSide}, {"type", "SCALAR"}}};
  Json primitive = {{"attributes", {{"POSITION", 0}, {"NORMAL", 1}, {"TEXCOORD_0", 2}, {"COLOR_0", 3}}},
                    {"indices", 4}};
  primitive["extensions"][kExtension] = {{"bufferView", 0}, {"attributes", mesh.attributes}};
  b.json["meshes"] = {{{"primitives", {primitive}}}};
  b.json["nodes"] = {{{"mesh", 0}}, {{"mesh", 0}, {"translation", {100, 0, 0}}}};
  b.json["extensionsUsed"] = b.json["extensionsRequired"] = {kExtension};
  return b;
}

Json& ExtensionOf(Builder& b) { return b.json["meshes"][0]["primitives"][0]["extensions"][kExtension]; }

GltfDecoding Decoding(const TemporaryFolder& folder) {
  ::signal(SIGPIPE, SIG_IGN);
  return {FindProgram("quarry-import-draco"), folder.file(""), 256u << 20};
}

/// The error's sentence without the folder, or "" if it went well.
std::string Import(Builder b, RecordingSink& sink, uint64_t memory = 256u << 20) {
  const TemporaryFolder folder;
  GltfDecoding decoding = Decoding(folder);
  decoding.memory = memory;
  const Status status = ImportModel(folder.Write("m.gltf", b.Text()), sink, {}, 0, decoding);
  return status ? "" : status.error().message.substr(folder.file("").size());
}

std::string ErrorOf(Builder b) {
  RecordingSink sink;
  return Import(std::move(b), sink);
}

/// Checks all attributes of all corners of all triangles, `error` at most beside their places.
void CheckGrid(const RecordingSink& sink, double error) {
  REQUIRE(sink.polygons.size() == 2u * 2 * kSide * kSide);
  double area = 0;
  for (const auto& polygon : sink.polygons) {
    REQUIRE(polygon.corners.size() == 3);
    std::array<glm::dvec3, 3> p;
    for (size_t k = 0; k < 3; ++k) {
      const Corner& corner = polygon.corners[k];
      p[k] = sink.positions[corner.position];
      const double x = p[k].x >= 50 ? p[k].x - 100 : p[k].x;
      const int column = static_cast<int>(std::lround(x)), row = static_cast<int>(std::lround(p[k].y));
      const GridCorner wanted = CornerAt(column, row);
      REQUIRE(std::fabs(x - wanted.position[0]) <= error);
      REQUIRE(std::fabs(p[k].y - wanted.position[1]) <= error);
      REQUIRE(std::fabs(p[k].z - wanted.position[2]) <= error);
      REQUIRE(glm::distance(sink.normals[corner.normal], glm::vec3(0, 0, 1)) < 0.01f);
      REQUIRE(std::fabs(sink.uvs[corner.uv].x - wanted.uv[0]) <= error);
      REQUIRE(std::fabs(sink.uvs[corner.uv].y - wanted.uv[1]) <= error);
      REQUIRE(sink.colors[corner.position].r == wanted.color[0]);
      REQUIRE(sink.colors[corner.position].g == wanted.color[1]);
      p[k].z = 0;
    }
    area += glm::cross(p[1] - p[0], p[2] - p[0]).z / 2;  // positive where it turns counter-clockwise
  }
  CHECK(area == Approx(2 * kSide * kSide).epsilon(0.01));
}

}  // namespace

TEST_CASE("glTF by Draco: both methods, quantised and exact", "[import][gltf][draco]") {
  for (const int method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING})
    for (const int bits : {0, 14}) {
      INFO("method " << method << ", " << bits << " bits");
      RecordingSink sink;
      REQUIRE(Import(Document(Encode(method, bits)), sink).empty());
      CheckGrid(sink, bits == 0 ? 1e-6 : 0.01);
      CHECK(sink.warnings.empty());
    }
}

TEST_CASE("glTF by Draco: the mode of strips gives the same triangles; others are refused",
          "[import][gltf][draco]") {
  Builder b = Document(Encode(draco::MESH_EDGEBREAKER_ENCODING, 14));
  b.json["meshes"][0]["primitives"][0]["mode"] = 5;
  RecordingSink sink;
  REQUIRE(Import(b, sink).empty());
  CheckGrid(sink, 0.01);
  b.json["meshes"][0]["primitives"][0]["mode"] = 6;
  CHECK_THAT(
      ErrorOf(b),
      Catch::Contains("a primitive of meshes[0].KHR_draco_mesh_compression: is not allowed for the mode 6"));
}

TEST_CASE("glTF by Draco: morph targets beside a compressed mesh", "[import][gltf][draco]") {
  Builder b = Document(Encode(draco::MESH_SEQUENTIAL_ENCODING, 0));
  RecordingSink plain, moved;
  REQUIRE(Import(b, plain).empty());
  const size_t count = plain.positions.size() / 2;
  std::vector<float> up;
  for (size_t i = 0; i < count; ++i) up.insert(up.end(), {0, 0, 3});
  const size_t target = b.Accessor(up, "VEC3", 5126);
  b.json["meshes"][0]["primitives"][0]["targets"] = {{{"POSITION", target}}};
  b.json["meshes"][0]["weights"] = {2};
  REQUIRE(Import(b, moved).empty());
  REQUIRE(moved.positions.size() == plain.positions.size());
  for (size_t i = 0; i < plain.positions.size(); ++i)
    CHECK(moved.positions[i] == plain.positions[i] + glm::dvec3(0, 0, 6));
}

TEST_CASE("glTF by Draco: a copy without compression is read, unless the extension is required",
          "[import][gltf][draco]") {
  Builder b = Document(Encode(draco::MESH_EDGEBREAKER_ENCODING, 14));
  Json& primitive = b.json["meshes"][0]["primitives"][0];
  const size_t position = b.Accessor(kSquare, "VEC3", 5126);
  primitive["attributes"] = {{"POSITION", position}};
  primitive["indices"] = b.Accessor(std::vector<uint16_t>{0, 1, 2, 0, 2, 3}, "SCALAR", 5123);
  RecordingSink required, optional;
  REQUIRE(Import(b, required).empty());
  CHECK(required.polygons.size() == 2u * 2 * kSide * kSide);
  b.json.erase("extensionsRequired");
  REQUIRE(Import(b, optional).empty());
  CHECK(optional.polygons.size() == 4);
}

TEST_CASE("glTF by Draco: invalid members are refused with one sentence", "[import][gltf][draco]") {
  const Builder sound = Document(Encode(draco::MESH_EDGEBREAKER_ENCODING, 14));
  const auto refused = [&](auto&& change, const char* sentence) {
    Builder b = sound;
    change(b);
    const std::string error = ErrorOf(b);
    CHECK_THAT(error, Catch::StartsWith("m.gltf: ") && Catch::Contains(sentence));
    CHECK(std::count(error.begin(), error.end(), '\n') == 0);
  };
  refused([](Builder& b) { ExtensionOf(b)["attributes"].erase("POSITION"); },
          "KHR_draco_mesh_compression.attributes.POSITION is missing");
  refused([](Builder& b) { ExtensionOf(b).erase("bufferView"); },
          "KHR_draco_mesh_compression.bufferView is missing");
  refused([](Builder& b) { ExtensionOf(b)["bufferView"] = 9; }, "bufferViews[9] is not there");
  refused([](Builder& b) { ExtensionOf(b)["attributes"]["NORMAL"] = 77; }, "it has no attribute 77");
  refused([](Builder& b) { ExtensionOf(b)["attributes"]["NORMAL"] = -1; }, "NORMAL is not a whole number");
  refused([](Builder& b) { b.json["bufferViews"][0]["byteLength"] = uint64_t{1} << 60; },
          "buffers[0] ends at byte");
  refused([](Builder& b) { b.json["accessors"][2]["type"] = "VEC3"; },
          "accessors[2]: has 3 components, but its compressed attribute 2");
  refused(
      [](Builder& b) {
        ExtensionOf(b)["attributes"].erase("NORMAL");
        b.json["accessors"][1]["count"] = 3;
      },
      "attributes of");
  refused([](Builder& b) { b.buffer[5] = 77; },
          "is of a version of Draco's format that the installed libdraco does not read");
  refused([](Builder& b) { b.buffer[0] = 'X'; }, "bufferViews[0]: cannot be decoded (");
}

TEST_CASE("glTF by Draco: the decoder stays within its memory, and a missing decoder is an error",
          "[import][gltf][draco]") {
  const Builder b = Document(Encode(draco::MESH_EDGEBREAKER_ENCODING, 14));
  const TemporaryFolder folder;
  Builder text = b;
  const std::string path = folder.Write("m.gltf", text.Text());
  const auto error_of = [&](const std::string& program) {
    RecordingSink sink;
    GltfDecoding decoding = Decoding(folder);
    decoding.draco = program;
    return ImportModel(path, sink, {}, 0, decoding).error().message;
  };
  CHECK_THAT(error_of(""),
             Catch::Contains("needs quarry-import-draco, which is not installed with this program"));
  CHECK_THAT(error_of("/bin/false"), Catch::Contains("/bin/false, has ended before its answer (status 1)"));
  CHECK_THAT(error_of("/nowhere/it"), Catch::Contains("/nowhere/it: cannot be started"));
  const auto script = [&](const char* name, const char* lines) {
    const std::string file = folder.Write(name, std::string("#!/bin/sh\n") + lines);
    std::filesystem::permissions(file, std::filesystem::perms::owner_all);
    return file;
  };
  CHECK_THAT(error_of(script("crash", "kill -SEGV $$\n")),
             Catch::Contains("meshes[0].KHR_draco_mesh_compression: bufferViews[0]: the decoder has crashed "
                             "on it: it is damaged"));
  CHECK_THAT(error_of(script("kill", "kill -KILL $$\n")), Catch::Contains("was ended by signal 9"));
  CHECK_THAT(error_of(script("time", "kill -XCPU $$\n")),
             Catch::Contains("takes its decoder more than ten minutes"));
  CHECK_THAT(error_of(script("library", "exit 127\n")),
             Catch::Contains("install Draco (Debian's package libdraco7)"));
  CHECK_THAT(error_of(script("lies", "printf '\\1\\0\\0\\0\\4\\0\\0\\0abcd'\ncat > /dev/null\n")),
             Catch::Contains("the decoder gives an invalid answer"));
}

TEST_CASE("glTF by Draco: a mesh larger than the decoder's memory is refused", "[import][gltf][draco]") {
  // The compressed bytes alone exceed the limit: the helper answers before it has read them all.
  Builder b = Document(Encode(draco::MESH_EDGEBREAKER_ENCODING, 14));
  b.buffer.resize(100u << 20);
  b.json["bufferViews"][0]["byteLength"] = b.buffer.size();
  const TemporaryFolder folder;
  GltfDecoding decoding = Decoding(folder);
  decoding.memory = 16u << 20;
  RecordingSink sink;
  CHECK_THAT(ImportModel(folder.Write("m.glb", b.Glb()), sink, {}, 0, decoding).error().message,
             Catch::Contains("needs more memory to be decoded than --memory"));
}

TEST_CASE("glTF by Draco: cut and changed bytes give a model or one sentence",
          "[import][gltf][draco][long]") {
  for (const int method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
    const Compressed whole = Encode(method, 11);
    uint64_t refused = 0;
    const auto check = [&](const Compressed& mesh) {
      const std::string error = ErrorOf(Document(mesh));
      if (error.empty()) return;
      ++refused;
      REQUIRE_THAT(error, Catch::StartsWith("m.gltf: "));
      REQUIRE(std::count(error.begin(), error.end(), '\n') == 0);
    };
    const size_t step = std::max<size_t>(whole.bytes.size() / 100, 1);
    for (size_t cut = 0; cut < whole.bytes.size(); cut += step)
      check({whole.bytes.substr(0, cut), whole.attributes});
    CHECK(refused > 50);
    for (size_t i = 0; i < whole.bytes.size(); i += i < 64 ? 1 : step) {
      Compressed changed = whole;
      changed.bytes[i] = static_cast<char>(changed.bytes[i] ^ 0xFF);
      check(changed);
    }
  }
}

#include <meshoptimizer.h>

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <glm/geometric.hpp>
#include <glm/gtc/quaternion.hpp>

#include "tests/unit/gltf_builder.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

constexpr const char* kExtension = "EXT_meshopt_compression";
constexpr uint32_t kSide = 40;  // vertices of a grid; its attributes fill several of the codec's blocks

std::vector<float> GridPositions(float lift) {
  std::vector<float> out;
  for (uint32_t y = 0; y < kSide; ++y)
    for (uint32_t x = 0; x < kSide; ++x)
      out.insert(out.end(), {static_cast<float>(x), static_cast<float>(y),
                             lift * std::sin(static_cast<float>(x * y) * 0.1f)});
  return out;
}

template <class Index>
std::vector<Index> GridIndices() {
  std::vector<Index> out;
  for (uint32_t y = 0; y + 1 < kSide; ++y)
    for (uint32_t x = 0; x + 1 < kSide; ++x) {
      const auto at = [&](uint32_t dx, uint32_t dy) { return static_cast<Index>((y + dy) * kSide + x + dx); };
      out.insert(out.end(), {at(0, 0), at(1, 0), at(1, 1), at(0, 0), at(1, 1), at(0, 1)});
    }
  return out;
}

/// Encodes `bytes` by the library's own encoder.
std::string Encoded(const std::string& bytes, const std::string& mode, size_t stride) {
  const size_t count = bytes.size() / stride;
  std::string out;
  const auto* from = bytes.data();
  std::vector<unsigned> indices;
  for (size_t i = 0; mode != "ATTRIBUTES" && i < count; ++i) {
    unsigned index = 0;
    std::memcpy(&index, from + i * stride, stride);
    indices.push_back(index);
  }
  const auto encode = [&](size_t bound, auto&& encoder) {
    out.resize(bound);
    out.resize(encoder(reinterpret_cast<unsigned char*>(out.data()), bound));
  };
  if (mode == "ATTRIBUTES")
    encode(meshopt_encodeVertexBufferBound(count, stride), [&](unsigned char* to, size_t room) {
      return meshopt_encodeVertexBuffer(to, room, from, count, stride);
    });
  else if (mode == "TRIANGLES")
    encode(meshopt_encodeIndexBufferBound(count, 1u << 20), [&](unsigned char* to, size_t room) {
      return meshopt_encodeIndexBuffer(to, room, indices.data(), count);
    });
  else
    encode(meshopt_encodeIndexSequenceBound(count, 1u << 20), [&](unsigned char* to, size_t room) {
      return meshopt_encodeIndexSequence(to, room, indices.data(), count);
    });
  return out;
}

/// Compresses a view of the document; its bytes stand in a buffer that is only a fallback, without bytes.
void Compress(Builder& b, size_t view, const std::string& mode, size_t stride,
              const std::string& filter = "NONE") {
  Json& json = b.json["bufferViews"][view];
  const size_t length = json["byteLength"];
  const std::string encoded = Encoded(b.buffer.substr(json["byteOffset"], length), mode, stride);
  json["buffer"] = 1;
  json["extensions"][kExtension] = {
      {"buffer", 0},          {"byteOffset", b.buffer.size()}, {"byteLength", encoded.size()},
      {"byteStride", stride}, {"count", length / stride},      {"mode", mode}};
  if (filter != "NONE") json["extensions"][kExtension]["filter"] = filter;
  if (mode == "ATTRIBUTES") json["byteStride"] = stride;
  b.buffer += encoded;
  b.other_buffers = {{{"byteLength", 1u << 20}, {"extensions", {{kExtension, {{"fallback", true}}}}}}};
  b.json["extensionsUsed"] = b.json["extensionsRequired"] = {kExtension, "KHR_mesh_quantization"};
}

/// A grid with all attributes that are read and a morph target.
template <class Index>
Builder Grid() {
  Builder b;
  const std::vector<float> positions = GridPositions(1);
  std::vector<float> normals;
  std::vector<uint16_t> uvs;
  std::vector<uint8_t> colors;
  for (uint32_t i = 0; i < kSide * kSide; ++i) {
    const float angle = static_cast<float>(i) * 0.01f;
    normals.insert(normals.end(), {std::sin(angle), 0, std::cos(angle)});
    uvs.insert(uvs.end(), {static_cast<uint16_t>(i * 40), static_cast<uint16_t>(i * 7)});
    colors.insert(colors.end(), {static_cast<uint8_t>(i), static_cast<uint8_t>(i / 7), 100, 255});
  }
  Json primitive;
  primitive["attributes"]["POSITION"] = b.Accessor(positions, "VEC3", 5126);
  primitive["attributes"]["NORMAL"] = b.Accessor(normals, "VEC3", 5126);
  primitive["attributes"]["TEXCOORD_0"] = b.Accessor(uvs, "VEC2", 5123, true);
  primitive["attributes"]["COLOR_0"] = b.Accessor(colors, "VEC4", 5121, true);
  primitive["targets"] = {{{"POSITION", b.Accessor(GridPositions(0.25f), "VEC3", 5126)}}};
  primitive["indices"] = b.Accessor(GridIndices<Index>(), "SCALAR", sizeof(Index) == 2 ? 5123 : 5125);
  b.json["meshes"] = {{{"primitives", {primitive}}, {"weights", {0.5}}}};
  b.json["nodes"] = {{{"mesh", 0}}, {{"mesh", 0}, {"translation", {100, 0, 0}}}};
  return b;
}

constexpr size_t kIndexView = 5;

template <class Index>
Builder CompressedGrid(const std::string& mode) {
  Builder b = Grid<Index>();
  for (const auto& [view, stride] :
       std::vector<std::pair<size_t, size_t>>{{0, 12}, {1, 12}, {2, 4}, {3, 4}, {4, 12}})
    Compress(b, view, "ATTRIBUTES", stride);
  Compress(b, kIndexView, mode, sizeof(Index));
  return b;
}

/// Each triangle from its lowest vertex on: the codec of triangles may begin at another corner.
std::vector<std::array<uint32_t, 3>> Triangles(const RecordingSink& sink) {
  std::vector<std::array<uint32_t, 3>> out;
  for (const auto& polygon : sink.polygons) {
    std::array<uint32_t, 3> t;
    for (size_t k = 0; k < 3; ++k) t[k] = polygon.corners[k].position;
    std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
    out.push_back(t);
  }
  return out;
}

void CheckSame(const RecordingSink& a, const RecordingSink& b) {
  REQUIRE(a.positions.size() == 2 * kSide * kSide);
  CHECK(a.positions == b.positions);
  CHECK(a.normals == b.normals);
  CHECK(a.uvs == b.uvs);
  REQUIRE(a.colors.size() == b.colors.size());
  for (size_t i = 0; i < a.colors.size(); ++i) REQUIRE(Packed(a.colors[i]) == Packed(b.colors[i]));
  CHECK(Triangles(a) == Triangles(b));
}

template <class Index>
void CheckGrid(const std::string& mode) {
  INFO(mode << " of " << sizeof(Index) << " bytes");
  RecordingSink plain, text, glb;
  REQUIRE(ImportText("m.gltf", Grid<Index>().Text(), plain).empty());
  REQUIRE(ImportText("m.gltf", CompressedGrid<Index>(mode).Text(), text).empty());
  REQUIRE(ImportText("m.glb", CompressedGrid<Index>(mode).Glb(), glb).empty());
  CheckSame(text, plain);
  CheckSame(glb, plain);
  CHECK(text.warnings.empty());
}

/// A square with normals, changed by `change`. Views: positions, normals, indices.
template <class Change>
Builder Square(Change&& change) {
  Builder b;
  Json primitive;
  primitive["attributes"]["POSITION"] = b.Accessor(kSquare, "VEC3", 5126);
  primitive["attributes"]["NORMAL"] = b.Accessor(
      std::vector<int8_t>{0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0}, "VEC4", 5120, true);
  b.json["accessors"].back()["type"] = "VEC3";
  b.json["bufferViews"].back()["byteStride"] = 4;
  primitive["indices"] = b.Accessor(std::vector<uint16_t>{0, 1, 2, 0, 2, 3}, "SCALAR", 5123);
  b.json["meshes"] = {{{"primitives", {primitive}}}};
  b.json["nodes"] = {{{"mesh", 0}}};
  change(b);
  return b;
}

Builder CompressedSquare() {
  return Square([](Builder& b) {
    Compress(b, 0, "ATTRIBUTES", 12);
    Compress(b, 1, "ATTRIBUTES", 4);
    Compress(b, 2, "TRIANGLES", 2);
  });
}

Json& ExtensionOf(Builder& b, size_t view) { return b.json["bufferViews"][view]["extensions"][kExtension]; }

/// Replaces a view's bytes by `filtered`, the output of an encoding filter.
template <class T>
void Refill(Builder& b, size_t view, const std::vector<T>& filtered) {
  while (b.buffer.size() % 4 != 0) b.buffer.push_back('\0');
  b.json["bufferViews"][view]["byteOffset"] = b.buffer.size();
  b.json["bufferViews"][view]["byteLength"] = filtered.size() * sizeof(T);
  b.buffer.append(reinterpret_cast<const char*>(filtered.data()), filtered.size() * sizeof(T));
}

}  // namespace

TEST_CASE("glTF by meshopt: a compressed model is the same as the plain one", "[import][gltf][meshopt]") {
  CheckGrid<uint16_t>("TRIANGLES");
  CheckGrid<uint32_t>("TRIANGLES");
  CheckGrid<uint16_t>("INDICES");
  CheckGrid<uint32_t>("INDICES");
}

TEST_CASE("glTF by meshopt: octahedral normals of 8 and of 16 bits", "[import][gltf][meshopt]") {
  std::vector<float> normals;
  for (int i = 0; i < 4; ++i) {
    const glm::vec3 n = glm::normalize(glm::vec3(i - 1.5f, 0.5f * static_cast<float>(i), 1.0f - i));
    normals.insert(normals.end(), {n.x, n.y, n.z, 0});
  }
  for (const size_t stride : {size_t{4}, size_t{8}}) {
    RecordingSink sink;
    REQUIRE(ImportText("m.gltf", Square([&](Builder& b) {
                                   std::vector<uint8_t> filtered(4 * stride);
                                   meshopt_encodeFilterOct(filtered.data(), 4, stride, stride == 4 ? 8 : 16,
                                                           normals.data());
                                   Refill(b, 1, filtered);
                                   b.json["accessors"][1]["componentType"] = stride == 4 ? 5120 : 5122;
                                   Compress(b, 1, "ATTRIBUTES", stride, "OCTAHEDRAL");
                                 }).Text(),
                       sink)
                .empty());
    REQUIRE(sink.normals.size() == 4);
    for (size_t i = 0; i < 4; ++i)
      CHECK(glm::distance(sink.normals[i], glm::vec3(normals[4 * i], normals[4 * i + 1],
                                                     normals[4 * i + 2])) < (stride == 4 ? 0.02f : 1e-4f));
  }
}

TEST_CASE("glTF by meshopt: quaternions turn instances", "[import][gltf][meshopt]") {
  // No turn, and half a turn about z.
  const std::vector<float> turns = {0, 0, 0, 1, 0, 0, 1, 0};
  RecordingSink sink;
  REQUIRE(
      ImportText(
          "m.gltf",
          Square([&](Builder& b) {
            std::vector<int16_t> filtered(8);
            meshopt_encodeFilterQuat(filtered.data(), 2, 8, 16, turns.data());
            const size_t turn = b.Accessor(filtered, "VEC4", 5122, true);
            Compress(b, 3, "ATTRIBUTES", 8, "QUATERNION");
            b.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {{"ROTATION", turn}};
          }).Text(),
          sink)
          .empty());
  REQUIRE(sink.positions.size() == 8);
  CHECK(glm::distance(sink.positions[2], glm::dvec3(1, 1, 0)) < 1e-3);
  CHECK(glm::distance(sink.positions[6], glm::dvec3(-1, -1, 0)) < 1e-3);
}

TEST_CASE("glTF by meshopt: exponential floats", "[import][gltf][meshopt]") {
  RecordingSink sink;
  REQUIRE(ImportText("m.gltf", Square([&](Builder& b) {
                                 std::vector<uint32_t> filtered(12);
                                 meshopt_encodeFilterExp(filtered.data(), 4, 12, 20, kSquare.data());
                                 Refill(b, 0, filtered);
                                 Compress(b, 0, "ATTRIBUTES", 12, "EXPONENTIAL");
                               }).Text(),
                     sink)
              .empty());
  REQUIRE(sink.positions.size() == 4);
  CHECK(glm::distance(sink.positions[2], glm::dvec3(1, 1, 0)) < 1e-5);
}

TEST_CASE("glTF by meshopt: sparse elements are compressed too", "[import][gltf][meshopt]") {
  RecordingSink sink;
  REQUIRE(ImportText("m.gltf", Square([&](Builder& b) {
                                 const std::vector<uint32_t> indices = {1, 2};
                                 const std::vector<float> values = {5, 0, 0, 5, 1, 0};
                                 b.Accessor(indices, "SCALAR", 5125);
                                 b.Accessor(values, "VEC3", 5126);
                                 Compress(b, 3, "INDICES", 4);
                                 Compress(b, 4, "ATTRIBUTES", 12);
                                 b.json["accessors"][0]["sparse"] = {
                                     {"count", 2},
                                     {"indices", {{"bufferView", 3}, {"componentType", 5125}}},
                                     {"values", {{"bufferView", 4}}}};
                               }).Text(),
                     sink)
              .empty());
  CHECK(sink.positions[2] == glm::dvec3(5, 1, 0));
}

TEST_CASE("glTF by meshopt: impossible parameters are refused with one sentence", "[import][gltf][meshopt]") {
  struct Row {
    size_t view;
    const char* key;
    Json value;
    const char* sentence;
  };
  const std::vector<Row> rows = {
      {0, "mode", "POINTS", "the mode \"POINTS\" is unknown"},
      {0, "filter", "CUBIC", "has the filter \"CUBIC\", which is unknown"},
      {0, "filter", "QUATERNION", "has a byteStride of 12 for the filter QUATERNION"},
      {0, "filter", "OCTAHEDRAL", "has a byteStride of 12 for the filter OCTAHEDRAL"},
      {0, "byteStride", 6, "has a byteStride of 6, which is not a multiple of 4"},
      {0, "byteStride", 0, "has a byteStride of 0"},
      {0, "byteStride", 260, "has a byteStride of 260"},
      {0, "byteStride", 4, "fewer than the view's 48 bytes"},
      {0, "count", 3, "its 3 elements of 12 bytes are fewer than the view's 48 bytes"},
      {0, "count", uint64_t{1} << 40, "1099511627776 elements of 12 bytes cannot be decoded from"},
      {0, "count", ~uint64_t{0}, "cannot be decoded from"},
      {0, "count", -1, "count is not a whole number"},
      {0, "byteLength", uint64_t{1} << 62, "buffers[0] ends at byte"},
      {0, "byteOffset", ~uint64_t{0}, "buffers[0] ends at byte"},
      {0, "buffer", 1, "buffers[1]: has no uri"},
      {0, "buffer", 7, "buffers[7] is not there"},
      {2, "byteStride", 8, "has a byteStride of 8 for indices"},
      {2, "filter", "EXPONENTIAL", "has a filter for indices"},
      {2, "count", 7, "has 7 indices, which are not whole triangles"},
      {2, "count", 3 << 20, "cannot be decoded from"},
      {2, "mode", "INDICES", "are damaged"},
  };
  for (const Row& row : rows) {
    INFO(row.key << " " << row.value);
    Builder b = CompressedSquare();
    ExtensionOf(b, row.view)[row.key] = row.value;
    const std::string error = ErrorOf("m.gltf", b.Text());
    CHECK_THAT(error, Catch::Contains(row.sentence) && Catch::StartsWith("m.gltf: "));
    CHECK(std::count(error.begin(), error.end(), '\n') == 0);
  }
  for (const char* key : {"buffer", "byteLength", "byteStride", "count"}) {
    Builder b = CompressedSquare();
    ExtensionOf(b, 0).erase(key);
    CHECK_THAT(ErrorOf("m.gltf", b.Text()),
               Catch::Contains(std::string("bufferViews[0].extensions.EXT_meshopt_compression.") + key));
  }
}

TEST_CASE("glTF by meshopt: a newer version of the codec is named", "[import][gltf][meshopt]") {
  Builder b = CompressedSquare();
  b.buffer[ExtensionOf(b, 0)["byteOffset"].get<size_t>()] = '\xAE';
  CHECK_THAT(
      ErrorOf("m.gltf", b.Text()),
      Catch::Contains("bufferViews[0].extensions.EXT_meshopt_compression: is of version 14 of the codec"));
}

TEST_CASE("glTF by meshopt: decoding takes at most half of the memory", "[import][gltf][meshopt]") {
  const TemporaryFolder folder;
  const std::string path = folder.Write("m.glb", CompressedGrid<uint32_t>("TRIANGLES").Glb());
  GltfDecoding decoding;
  decoding.folder = folder.file("");
  decoding.memory = 2 << 20;
  RecordingSink sink;
  REQUIRE(ImportModel(path, sink, {}, 0, decoding));
  decoding.memory = 20000;  // the positions take 19,200 bytes, and their compressed bytes
  RecordingSink other;
  CHECK_THAT(ImportModel(path, other, {}, 0, decoding).error().message,
             Catch::Contains("takes 1 MiB to decode, more than half of --memory"));
  decoding.memory = 2 << 20;
  decoding.folder = folder.file("nowhere");
  CHECK_THAT(ImportModel(path, other, {}, 0, decoding).error().message,
             Catch::Contains("a file for decoded bytes cannot be made"));
}

TEST_CASE("glTF by meshopt: cut streams are refused, each with one sentence", "[import][gltf][meshopt]") {
  for (const char* mode : {"TRIANGLES", "INDICES"})
    for (const size_t view : {size_t{0}, size_t{2}}) {
      Builder whole = Square([&](Builder& b) {
        Compress(b, 0, "ATTRIBUTES", 12);
        Compress(b, 2, mode, 2);
      });
      const size_t length = ExtensionOf(whole, view)["byteLength"];
      for (size_t cut = 0; cut < length; ++cut) {
        Builder b = whole;
        ExtensionOf(b, view)["byteLength"] = cut;
        const std::string error = ErrorOf("m.gltf", b.Text());
        INFO(mode << ", view " << view << ", " << cut << " of " << length << ": " << error);
        REQUIRE_THAT(error, Catch::StartsWith("m.gltf: bufferViews[" + std::to_string(view)));
      }
    }
}

TEST_CASE("glTF by meshopt: changed bytes give a model or a sentence", "[import][gltf][meshopt]") {
  uint64_t refused = 0;
  for (const char* mode : {"TRIANGLES", "INDICES"})
    for (const size_t view : {size_t{0}, size_t{1}, size_t{2}}) {
      const Builder whole = Square([&](Builder& b) {
        Compress(b, 0, "ATTRIBUTES", 12, "EXPONENTIAL");
        Compress(b, 1, "ATTRIBUTES", 4, "OCTAHEDRAL");
        Compress(b, 2, mode, 2);
      });
      Builder first = whole;
      const size_t offset = ExtensionOf(first, view)["byteOffset"],
                   length = ExtensionOf(first, view)["byteLength"];
      for (size_t i = 0; i < length; ++i)
        for (const int flip : {0x01, 0x10, 0x80, 0xFF}) {
          Builder b = whole;
          b.buffer[offset + i] = static_cast<char>(b.buffer[offset + i] ^ flip);
          const std::string error = ErrorOf("m.gltf", b.Text());
          if (error.empty()) continue;
          ++refused;
          REQUIRE_THAT(error, Catch::StartsWith("m.gltf: "));
          REQUIRE(std::count(error.begin(), error.end(), '\n') == 0);
        }
    }
  CHECK(refused > 0);
}

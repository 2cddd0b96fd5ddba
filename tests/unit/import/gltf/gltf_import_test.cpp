#include <array>
#include <catch2/catch.hpp>
#include <glm/geometric.hpp>

#include "tests/unit/gltf_builder.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

/// Two nodes show one square; the second is moved, mirrored and a child of the first.
Builder TwoSquares() {
  Builder b;
  const size_t position = b.Accessor(kSquare, "VEC3", 5126);
  const size_t normal = b.Accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, "VEC3", 5126);
  const size_t uv =
      b.Accessor(std::vector<uint16_t>{0, 0, 65535, 0, 65535, 65535, 0, 65535}, "VEC2", 5123, true);
  const size_t color =
      b.Accessor(std::vector<uint8_t>{255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 51, 51, 51, 0}, "VEC4",
                 5121, true);
  const size_t indices = b.Accessor(std::vector<uint16_t>{0, 1, 2, 0, 2, 3}, "SCALAR", 5123);
  b.json["materials"] = {
      {{"name", "glass"},
       {"pbrMetallicRoughness",
        {{"baseColorFactor", {0.5, 0.25, 1, 0.5}}, {"metallicFactor", 0}, {"roughnessFactor", 1}}},
       {"alphaMode", "BLEND"},
       {"emissiveFactor", {1, 0, 0}},
       {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 3}}}}}}};
  b.json["meshes"] = {
      {{"name", "square"},
       {"primitives",
        {{{"attributes",
           {{"POSITION", position}, {"NORMAL", normal}, {"TEXCOORD_0", uv}, {"COLOR_0", color}}},
          {"indices", indices},
          {"material", 0}}}}}};
  b.json["nodes"] = {
      {{"mesh", 0}, {"name", "first"}, {"translation", {10, 0, 0}}, {"children", {1}}},
      {{"mesh", 0}, {"scale", {-2, 1, 1}}, {"rotation", {0, 0, 0.7071067811865476, 0.7071067811865476}}}};
  b.json["scenes"] = {{{"nodes", {0}}}};
  return b;
}

void CheckTwoSquares(const RecordingSink& sink) {
  REQUIRE(sink.positions.size() == 8);
  CHECK(sink.positions[2] == glm::dvec3(11, 1, 0));
  // (1, 1, 0) times (-2, 1, 1), a quarter turn about z, moved by the parent.
  CHECK(glm::distance(sink.positions[6], glm::dvec3(9, -2, 0)) < 1e-12);
  CHECK(sink.parts == std::vector<std::string>{"first", "first/square"});
  REQUIRE(sink.polygons.size() == 4);
  CHECK(sink.polygons[0].corners[1].position == 1);
  CHECK(sink.polygons[2].corners[0].position == 4);
  // The mirror image is turned, so that faces keep their outer side.
  CHECK(sink.polygons[2].corners[1].position == 6);
  CHECK(sink.polygons[2].corners[2].position == 5);
  CHECK(sink.polygons[2].corners[2].normal == 5);
  CHECK(sink.polygons[2].corners[2].uv == 5);
  CHECK(glm::distance(sink.normals[4], glm::vec3(0, 0, 1)) < 1e-6f);
  CHECK(sink.uvs[2] == glm::vec2(1));
  CHECK((sink.colors[1].g == 255 && sink.colors[1].r == 0 && sink.colors[3].r == 51));
  // Beside the material its levels of alpha, since a vertex has 0.
  REQUIRE(sink.materials.size() == 1 + kAlphaLevels);
  CHECK(sink.materials[1].name == "glass, alpha 0/16");
  CHECK(sink.materials[1].transmittance == glm::vec3(1));
  CHECK(sink.materials[0].name == "glass");
  CHECK(sink.materials[0].diffuse == glm::vec3(0.25f, 0.125f, 0.5f));
  CHECK(sink.materials[0].transmittance == glm::vec3(0.5f));
  CHECK(sink.materials[0].emission == glm::vec3(3, 0, 0));
}

/// The sentence for TwoSquares after a change to its JSON.
template <class Change>
std::string ErrorAfter(Change&& change) {
  Builder b = TwoSquares();
  change(b.json);
  return ErrorOf("m.gltf", b.Text());
}

}  // namespace

TEST_CASE("glTF: nodes, instances, attributes, materials", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(ImportText("m.gltf", TwoSquares().Text(), sink).empty());
  CHECK(sink.ended);
  CheckTwoSquares(sink);
}

TEST_CASE("GLB is the same in one file, recognised by its content", "[import][gltf]") {
  RecordingSink sink;
  REQUIRE(ImportText("m", TwoSquares().Glb(), sink).empty());
  CheckTwoSquares(sink);
}

TEST_CASE("glTF: buffers in files of their own, names percent-encoded", "[import][gltf]") {
  const TemporaryFolder folder;
  Builder b = TwoSquares();
  folder.Write("the data.bin", b.buffer);
  b.json["buffers"] = {{{"byteLength", b.buffer.size()}, {"uri", "the%20data.bin"}}};
  RecordingSink sink;
  const Status status = ImportModel(folder.Write("m.gltf", b.json.dump()), sink);
  REQUIRE(status.has_value());
  CheckTwoSquares(sink);
}

TEST_CASE("glTF: strips, fans, no indices, strides, sparse elements", "[import][gltf]") {
  Builder b;
  std::vector<float> zigzag;
  for (int i = 0; i < 6; ++i)
    zigzag.insert(zigzag.end(), {static_cast<float>(i), static_cast<float>(i % 2), 0});
  const size_t position = b.Accessor(zigzag, "VEC3", 5126);
  b.json["meshes"] = {{{"primitives", Json::array()}}};
  for (int mode : {5, 6, 4, 1})
    b.json["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", position}}}, {"mode", mode}});
  b.json["nodes"] = {{{"mesh", 0}}};
  RecordingSink sink;
  REQUIRE(ImportText("m.gltf", b.Text(), sink).empty());
  REQUIRE(sink.polygons.size() == 4 + 4 + 2);
  const auto corners = [&](size_t polygon) {
    const auto& c = sink.polygons[polygon].corners;
    return std::array<uint32_t, 3>{c[0].position, c[1].position, c[2].position};
  };
  CHECK(corners(0) == std::array<uint32_t, 3>{0, 1, 2});
  CHECK(corners(1) == std::array<uint32_t, 3>{1, 3, 2});
  CHECK(corners(2) == std::array<uint32_t, 3>{2, 3, 4});
  CHECK(corners(4) == std::array<uint32_t, 3>{6, 7, 8});
  CHECK(corners(7) == std::array<uint32_t, 3>{6, 10, 11});
  CHECK(corners(9) == std::array<uint32_t, 3>{15, 16, 17});
  REQUIRE(sink.warnings.size() == 1);
  CHECK_THAT(sink.warnings[0], Catch::Contains("1 primitives without triangles"));

  // Every second vertex by a stride, and one of them replaced.
  b.json["bufferViews"][0]["byteStride"] = 24;
  b.json["accessors"][0]["count"] = 3;
  const size_t index = b.Accessor(std::vector<uint8_t>{1}, "SCALAR", 5121);
  const size_t value = b.Accessor(std::vector<float>{7, 8, 9}, "VEC3", 5126);
  b.json["accessors"][0]["sparse"] = {{"count", 1},
                                      {"indices", {{"bufferView", index}, {"componentType", 5121}}},
                                      {"values", {{"bufferView", value}}}};
  RecordingSink sparse;
  REQUIRE(ImportText("m.gltf", b.Text(), sparse).empty());
  CHECK(sparse.positions[0] == glm::dvec3(0));
  CHECK(sparse.positions[1] == glm::dvec3(7, 8, 9));
  CHECK(sparse.positions[2] == glm::dvec3(4, 0, 0));
}

TEST_CASE("glTF: elements that no buffer holds have a limit", "[import][gltf]") {
  const auto error_of = [](uint64_t count, bool sparse) {
    Builder b;
    const size_t index = b.Accessor(std::vector<uint8_t>{1}, "SCALAR", 5121);
    const size_t value = b.Accessor(std::vector<float>{7, 8, 9}, "VEC3", 5126);
    b.json["accessors"].push_back({{"componentType", 5126}, {"count", count}, {"type", "VEC3"}});
    if (sparse)
      b.json["accessors"].back()["sparse"] = {{"count", 1},
                                              {"indices", {{"bufferView", index}, {"componentType", 5121}}},
                                              {"values", {{"bufferView", value}}}};
    b.json["meshes"] = {{{"primitives", {{{"attributes", {{"POSITION", 2}}}}}}}};
    b.json["nodes"] = {{{"mesh", 0}}};
    RecordingSink sink;
    const std::string error = ImportText("m.gltf", b.Text(), sink);
    if (!error.empty()) CHECK(sink.positions.empty());
    return error;
  };
  CHECK(error_of(300, true).empty());
  for (const bool sparse : {false, true})
    CHECK_THAT(error_of(4000000000, sparse), Catch::Contains("elements without a buffer view"));
}

TEST_CASE("glTF: impossible values are refused with one sentence", "[import][gltf]") {
  CHECK_THAT(ErrorAfter([](Json& j) { j["asset"]["version"] = "1.0"; }), Catch::Contains("is not glTF 2"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["count"] = 5; }),
             Catch::Contains("its 5 elements go beyond bufferViews[0]"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["count"] = -1; }),
             Catch::Contains("count is not a whole number"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["count"] = 1ull << 40; }),
             Catch::Contains("more than 32 bits can count"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["type"] = "MAT3"; }),
             Catch::Contains("accessors[0]: its type is not"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["type"] = "VEC4"; }),
             Catch::Contains("accessors[0]"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["accessors"][0]["bufferView"] = 77; }),
             Catch::Contains("bufferViews[77] is not there"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["bufferViews"][0]["buffer"] = 3; }),
             Catch::Contains("buffers[3] is not there"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["bufferViews"][4]["byteOffset"] = 1000000; }),
             Catch::Contains("buffers[0] ends at byte"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["bufferViews"][0]["byteStride"] = 2; }),
             Catch::Contains("a byteStride of 2"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["nodes"][1]["children"] = {0}; }),
             Catch::Contains("is a child twice, or a child of itself"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["nodes"][0]["mesh"] = 9; }),
             Catch::Contains("meshes[9] is not there"));
  CHECK_THAT(ErrorAfter([](Json& j) {
               j["nodes"][0]["matrix"] = {1, 2};
             }),
             Catch::Contains("nodes[0].matrix does not have 16 numbers"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["nodes"][0]["name"] = 5; }), Catch::Contains("has the wrong type"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["meshes"][0]["primitives"][0]["material"] = 1; }),
             Catch::Contains("materials[1] is not there"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 4; }),
             Catch::Contains("accessors[4]: has 1 components"));
  CHECK_THAT(ErrorAfter([](Json& j) { j["extensionsRequired"] = {"KHR_coming_compression"}; }),
             Catch::Contains("needs the extension \"KHR_coming_compression\""));
  CHECK_THAT(ErrorAfter([](Json& j) { j["scenes"][0]["nodes"] = Json::array(); }),
             Catch::Contains("holds no triangles"));
  // An index beyond the vertices.
  Builder b = TwoSquares();
  b.buffer[b.buffer.size() - 2] = 4;
  CHECK_THAT(ErrorOf("m.gltf", b.Text()),
             Catch::Contains("meshes[0]: index 5 is vertex 4, but there are only 4"));
  CHECK_THAT(ErrorOf("m.gltf", "{\"asset\": {\"version\": \"2.0\"}, "),
             Catch::Contains("not valid JSON at byte 31"));
  std::string glb = TwoSquares().Glb();
  glb.resize(glb.size() - 1);
  CHECK_THAT(ErrorOf("m.glb", glb), Catch::Contains("the binary chunk's"));
  glb.resize(40);
  CHECK_THAT(ErrorOf("m.glb", glb), Catch::Contains("go beyond the file"));
  CHECK_THAT(ErrorOf("m.glb", "glTF"), Catch::Contains("m.glb"));
}

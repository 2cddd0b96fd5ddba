#include <catch2/catch.hpp>
#include <cstring>

#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

/// Binary PLY bodies, value by value, in either byte order.
struct Body {
  bool big;
  std::string bytes;

  template <typename T>
  Body& Put(T value) {
    char raw[sizeof(T)];
    std::memcpy(raw, &value, sizeof(T));
    for (size_t i = 0; i < sizeof(T); ++i) bytes += raw[big ? sizeof(T) - 1 - i : i];
    return *this;
  }
};

std::string Format(bool big) { return big ? "binary_big_endian" : "binary_little_endian"; }

const std::string kXyz = "property float x\nproperty float y\nproperty float z\n";
const std::string kTriangle = "ply\nformat ascii 1.0\nelement vertex 3\n" + kXyz +
                              "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
                              "0 0 0\n1 0 0\n0 1 0\n";

}  // namespace

TEST_CASE("PLY: ASCII with polygons, CRLF header, comments", "[import][ply]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.ply",
                     "ply\r\nformat ascii 1.0\r\ncomment hello\r\nobj_info none\r\nelement vertex 4\r\n"
                     "property double x\r\nproperty double y\r\nproperty double z\r\nelement face 2\r\n"
                     "property list uint8 uint32 vertex_index\r\nend_header\r\n"
                     "0 0 0.1\r\n1 0 nan\r\n+1e0 1. inf\r\n0 .5 0\r\n4 0 1 2 3\r\n2 0 1\r\n",
                     sink) == "");
  CHECK(sink.name == "a.ply");
  CHECK(sink.positions.size() == 4);
  CHECK(sink.positions[0].z == 0.1);
  CHECK(std::isnan(sink.positions[1].z));
  CHECK(std::isinf(sink.positions[2].z));
  REQUIRE(sink.polygons.size() == 1);
  CHECK(sink.polygons[0].corners.size() == 4);
  CHECK(sink.polygons[0].corners[0].normal == kNoIndex);
  REQUIRE(sink.warnings.size() == 1);
  CHECK(sink.warnings[0].find("1 faces of fewer than 3 corners") != std::string::npos);
  CHECK(sink.ended);
}

TEST_CASE("PLY: every type, lists anywhere, faces before vertices, both byte orders", "[import][ply]") {
  const bool big = GENERATE(false, true);
  Body body{big, {}};
  body.Put<int8_t>(2).Put<double>(1).Put<double>(2);  // an ignored list before the indices
  body.Put<uint16_t>(3).Put<int16_t>(2).Put<int16_t>(0).Put<int16_t>(1).Put<uint8_t>(9);
  body.Put<uint32_t>(7).Put<int64_t>(0);  // an unknown element: uint, double
  for (int i = 0; i < 3; ++i) {
    body.Put<double>(i + 0.1).Put<int32_t>(-i).Put<uint16_t>(static_cast<uint16_t>(i)).Put<int8_t>(-1);
    body.Put<float>(0).Put<float>(1).Put<float>(0);
    body.Put<uint16_t>(65535).Put<float>(0.5f).Put<uint8_t>(7).Put<uint8_t>(8);
    body.Put<float>(0.25f).Put<float>(0.75f);
  }
  RecordingSink sink;
  REQUIRE(ImportText("a.ply",
                     "ply\nformat " + Format(big) +
                         " 1.0\nelement face 1\nproperty list int8 float64 weights\n"
                         "property list ushort short vertex_indices\nproperty uchar flags\n"
                         "element odd 1\nproperty uint a\nproperty double b\n"
                         "element vertex 3\nproperty float64 x\nproperty int32 y\nproperty uint16 z\n"
                         "property char skipped\nproperty float nx\nproperty float ny\nproperty float nz\n"
                         "property ushort red\nproperty float green\nproperty uchar diffuse_blue\n"
                         "property uint8 alpha\nproperty float s\nproperty float texture_v\nend_header\n" +
                         body.bytes,
                     sink) == "");
  REQUIRE(sink.positions.size() == 3);
  CHECK(sink.positions[2] == glm::dvec3(2.1, -2, 2));
  CHECK(sink.normals[1] == glm::vec3(0, 1, 0));
  CHECK(sink.uvs[1] == glm::vec2(0.25f, 0.75f));
  CHECK(int{sink.colors[0].r} == 255);
  CHECK(int{sink.colors[0].g} == 55);
  CHECK(int{sink.colors[0].b} == 1);
  CHECK(int{sink.colors[0].a} == 8);
  REQUIRE(sink.polygons.size() == 1);
  CHECK(sink.polygons[0].corners[0].position == 2);
  CHECK(sink.polygons[0].corners[0].normal == 2);
  CHECK(sink.polygons[0].corners[0].uv == 2);
}

TEST_CASE("PLY: a vertex may hold lists, and rows pass the buffer's end", "[import][ply]") {
  Body body{false, {}};
  constexpr int kCount = 100000;
  for (int i = 0; i < kCount; ++i)
    body.Put<float>(static_cast<float>(i)).Put<uint8_t>(static_cast<uint8_t>(i % 3));
  std::string text;
  for (int i = 0; i < kCount; ++i) {
    Body row{false, {}};
    row.Put<float>(static_cast<float>(i)).Put<uint8_t>(static_cast<uint8_t>(i % 3));
    for (int k = 0; k < i % 3; ++k) row.Put<int32_t>(k);
    row.Put<float>(0).Put<float>(1);
    text += row.bytes;
  }
  Body face{false, {}};
  face.Put<uint8_t>(3).Put<int32_t>(0).Put<int32_t>(1).Put<int32_t>(kCount - 1);
  RecordingSink sink;
  REQUIRE(ImportText("a.ply",
                     "ply\nformat binary_little_endian 1.0\nelement vertex 100000\nproperty float x\n"
                     "property list uchar int neighbours\nproperty float y\nproperty float z\n"
                     "element face 1\nproperty list uchar int vertex_indices\nend_header\n" +
                         text + face.bytes,
                     sink) == "");
  CHECK(sink.positions[kCount - 1] == glm::dvec3(kCount - 1, 0, 1));
}

TEST_CASE("PLY: triangle strips turn every other triangle and restart at -1", "[import][ply]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.ply",
                     "ply\nformat ascii 1.0\nelement vertex 4\n" + kXyz +
                         "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
                         "0 0 0 1 0 0 0 1 0 1 1 0\n8 0 1 2 3 -1 1 2 3\n",
                     sink) == "");
  REQUIRE(sink.polygons.size() == 3);
  CHECK(sink.polygons[1].corners[0].position == 2);
  CHECK(sink.polygons[1].corners[1].position == 1);
  CHECK(sink.polygons[1].corners[2].position == 3);
  CHECK(sink.polygons[2].corners[0].position == 1);
}

TEST_CASE("PLY: materials and parts through the file beside it", "[import][ply]") {
  const std::string header = "ply\nformat ascii 1.0\nelement vertex 3\n" + kXyz +
                             "element face 2\nproperty list uchar int vertex_indices\n"
                             "property int material_index\nproperty int part_index\nend_header\n"
                             "0 0 0 1 0 0 0 1 0\n";
  const TemporaryFolder folder;
  RecordingSink sink;
  const std::string path = folder.Write("m.ply", header + "3 0 1 2 1 0\n3 0 1 2 0 1\n");
  REQUIRE(ImportModel(path, sink));
  CHECK(sink.warnings.size() == 1);
  CHECK(sink.polygons[0].material == kNoIndex);

  folder.Write("m.materials.json", R"({"materials": [{"name": "a"}, {"name": "b"}], "parts": ["p", "q"]})");
  RecordingSink with;
  REQUIRE(ImportModel(path, with));
  CHECK(with.warnings.empty());
  CHECK(with.materials[with.polygons[0].material].name == "b");
  CHECK(with.parts[with.polygons[1].part] == "q");

  folder.Write("m.ply", header + "3 0 1 2 1 0\n3 0 1 2 2 1\n");
  RecordingSink beyond;
  const Status status = ImportModel(path, beyond);
  REQUIRE_FALSE(status);
  CHECK(status.error().message.find("line 14: face 1 (counted from 0) has material_index 2") !=
        std::string::npos);
}

TEST_CASE("PLY: errors name the place", "[import][ply]") {
  const std::string ascii = "ply\nformat ascii 1.0\nelement vertex 3\n" + kXyz;
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\n";
  CHECK(ErrorOf("a.ply", "plx\n") == "a.ply, line 1: does not begin with \"ply\"");
  CHECK(ErrorOf("a.ply", "ply\nformat ascii 1.0\n") == "a.ply, line 3: the PLY header has no end_header");
  CHECK(ErrorOf("a.ply", "ply\nend_header\n") == "a.ply, line 2: the PLY header names no format");
  CHECK(ErrorOf("a.ply", "ply\nformat morse 1.0\n") ==
        "a.ply, line 2: the PLY format \"morse\" is not known");
  CHECK(ErrorOf("a.ply", ascii + "property half q\n") == "a.ply, line 7: the type \"half\" is not known");
  CHECK(ErrorOf("a.ply", ascii + "element vertex 3\n") ==
        "a.ply, line 7: the element \"vertex\" is named twice");
  CHECK(ErrorOf("a.ply", ascii + "element face -1\n") == "a.ply, line 7: the element \"face\" has no count");
  CHECK(ErrorOf("a.ply", ascii + "element face 1\nproperty list float int vertex_indices\n") ==
        "a.ply, line 8: the count of a list must have an integer type");
  CHECK(ErrorOf("a.ply", "ply\nformat ascii 1.0\nproperty int a\n") ==
        "a.ply, line 3: a property before any element");
  CHECK(ErrorOf("a.ply", "ply\nformat ascii 1.0\nend_header\n") ==
        "a.ply, line 4: the PLY header has no element \"vertex\"");
  CHECK(ErrorOf("a.ply", "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n") ==
        "a.ply, line 6: the element \"vertex\" lacks x, y or z");
  CHECK(ErrorOf("a.ply", ascii + "element face 1\nproperty int q\nend_header\n0 0 0 0 0 0 0 0 0 1") ==
        "a.ply, line 10: the element \"face\" has no list vertex_indices of an integer type");
  CHECK(ErrorOf("a.ply", kTriangle + "3 0 1 2").empty());
  CHECK(ErrorOf("a.ply", kTriangle + "3 0 1 x") ==
        "a.ply, line 13: \"x\" is not an integer in face 0 (counted from 0) of 1");
  CHECK(ErrorOf("a.ply", kTriangle + "3 0 1 3") ==
        "a.ply, line 13: face 0 (counted from 0) refers to vertex 3, but there are 3 vertices");
  CHECK(ErrorOf("a.ply", kTriangle + "3 0 -1 2") ==
        "a.ply, line 13: face 0 (counted from 0) refers to vertex -1, but there are 3 vertices");
  CHECK(ErrorOf("a.ply", kTriangle + "3 0 1") ==
        "a.ply, line 13: the file ends in face 0 (counted from 0) of 1");
  CHECK(ErrorOf("a.ply", kTriangle + "70000 0 1") ==
        "a.ply, line 13: face 0 (counted from 0) of 1 has 70000 corners, where 0 to 65536 are possible");
  CHECK(ErrorOf("a.ply", kTriangle + "2 0 1") == "a.ply: holds no triangles");
  CHECK(ErrorOf("a.ply", ascii + face + "end_header\n0 0 0\n1 zero 0\n") ==
        "a.ply, line 11: \"zero\" is not a number in vertex 1 (counted from 0) of 3");
}

TEST_CASE("PLY: truncated and boastful binary files end at once", "[import][ply]") {
  const std::string binary = "ply\nformat binary_little_endian 1.0\nelement vertex ";
  const std::string face = "element face 1\nproperty list uint int vertex_indices\n";
  const std::string rows(36, '\0');
  CHECK(
      ErrorOf("a.ply", binary + "9000000000000000000\n" + kXyz + face + "end_header\n" + rows) ==
      "a.ply, byte 186: the header promises 9000000000000000000 rows of 12 bytes for the element vertex, but "
      "the file has 36 bytes left");
  CHECK(ErrorOf("a.ply",
                binary + "3\n" + kXyz + face + "end_header\n" + rows + std::string("\x03\0\0\0\0", 5)) ==
        "a.ply, byte 209: the file ends in face 0 (counted from 0) of 1");
  CHECK(ErrorOf("a.ply", binary + "3\n" + kXyz + face + "end_header\n" + rows + "\xFF\xFF\xFF\xFF")
            .find("has 4294967295 corners, where 0 to 65536 are possible") != std::string::npos);
  // Rows of nothing take no bytes, so their count must not be believed.
  CHECK(ErrorOf("a.ply", binary + "3\n" + kXyz + "element nothing 9000000000000000000\n" + face +
                             "end_header\n" + rows + std::string("\x03\0\0\0\0\0\0\0\1\0\0\0\2\0\0\0", 16)) ==
        "");
}

#include <catch2/catch.hpp>

#include "preprocess/import/obj/obj_materials.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

const std::string kVertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

std::vector<uint32_t> PositionsOf(const RecordingSink::Polygon& polygon) {
  std::vector<uint32_t> result;
  for (const Corner& corner : polygon.corners) result.push_back(corner.position);
  return result;
}

}  // namespace

TEST_CASE("OBJ: corners in all forms, negative indices, polygons", "[import][obj]") {
  RecordingSink sink;
  REQUIRE(
      ImportText("a.obj",
                 kVertices +
                     "v 1 1 0\nvt 0.5 0.25 9\nvt 1\nvn 0 0 1\n"
                     "f 1 2 4 3\nf 1/2 2/1 3/1\nf 1//1 2//1 3//1\nf 1/1/1 2/2/1 3/0/0\nf -4/-1/-1 -3 -1//\n",
                 sink) == "");
  REQUIRE(sink.polygons.size() == 5);
  CHECK(sink.triangles == 6);
  CHECK(PositionsOf(sink.polygons[0]) == std::vector<uint32_t>{0, 1, 3, 2});
  CHECK(sink.polygons[1].corners[0].uv == 1);
  CHECK(sink.polygons[1].corners[0].normal == kNoIndex);
  CHECK(sink.polygons[2].corners[0].uv == kNoIndex);
  CHECK(sink.polygons[2].corners[0].normal == 0);
  CHECK(sink.polygons[3].corners[1].uv == 1);
  CHECK(sink.polygons[3].corners[2].uv == kNoIndex);
  CHECK(PositionsOf(sink.polygons[4]) == std::vector<uint32_t>{0, 1, 3});
  CHECK(sink.polygons[4].corners[0].uv == 1);
  CHECK(sink.uvs[0] == glm::vec2(0.5f, 0.25f));
  CHECK(sink.uvs[1] == glm::vec2(1, 0));
}

TEST_CASE("OBJ: smoothing groups", "[import][obj]") {
  RecordingSink sink;
  const std::string face = "f 1 2 3\n";
  REQUIRE(ImportText("a.obj",
                     kVertices + face + "s 1\n" + face + "s 70000\n" + face + "s off\n" + face + "S 3\n" +
                         face + "s 0\n" + face + "s 4\ns what\n" + face,
                     sink) == "");
  const uint16_t wanted[] = {
      kSmoothByAngle, SmoothingGroup(1), SmoothingGroup(70000), kFlat, SmoothingGroup(3),
      kFlat,          SmoothingGroup(4)};
  REQUIRE(sink.polygons.size() == std::size(wanted));
  for (size_t i = 0; i < std::size(wanted); ++i) CHECK(sink.polygons[i].smoothing == wanted[i]);
  for (const uint64_t group : {uint64_t{1}, uint64_t{65532}, uint64_t{65533}, ~uint64_t{0} >> 1})
    CHECK((SmoothingGroup(group) != kFlat && SmoothingGroup(group) != kOwnNormals &&
           SmoothingGroup(group) != kSmoothByAngle));
}

TEST_CASE("OBJ: numbers, colours, weights, white space, byte order mark, continued lines", "[import][obj]") {
  RecordingSink sink;
  REQUIRE(ImportText(
              "a.obj",
              "\xEF\xBB\xBF# made by hand in C:\\here\\\r\nv\t+1.5e+002  -.5 1.  \r\n  v 1 2 3 0.5\r\n"
              "v 1 2 3 1 0.5 2\r\nv nan -inf 1.#QNAN\r\nv 1e999 1e-999 -1.#INF\r\n"
              "f 1 \\\r\n 2 3 # tail\r\ns 1\r\nl 1 2\r\np 1\r\nvp 0 1\r\ncurv 0 1 1 2\r\nunknown\r\nf 3 2 1",
              sink) == "");
  CHECK(sink.positions[0] == glm::dvec3(150, -0.5, 1));
  CHECK(int{sink.colors[1].r} == 255);
  CHECK(int{sink.colors[2].g} == 55);
  CHECK(int{sink.colors[2].b} == 255);
  CHECK(std::isnan(sink.positions[3].z));
  CHECK(std::isinf(sink.positions[4].x));
  CHECK(sink.positions[4].y == 0);
  CHECK(sink.positions[4].z < 0);
  CHECK(sink.triangles == 2);
}

TEST_CASE("OBJ: a face may refer to vertices that come later", "[import][obj]") {
  CHECK(ErrorOf("a.obj", "f 1 2 3\n" + kVertices) == "");
}

TEST_CASE("OBJ: indices of missing normals and texture coordinates are left out", "[import][obj]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.obj", kVertices + "f 1/1/1 2/2/2 3/3/3\nvn 0 0 1\nvn 0 1 0\nvt 0 0\n", sink) == "");
  REQUIRE(sink.polygons.size() == 1);
  CHECK(sink.polygons[0].corners[1].normal == 1);
  CHECK(sink.polygons[0].corners[2].normal == kNoIndex);
  CHECK(sink.polygons[0].corners[0].uv == 0);
  CHECK(sink.polygons[0].corners[1].uv == kNoIndex);
  REQUIRE(sink.warnings.size() == 2);
  CHECK_THAT(sink.warnings[0],
             Catch::EndsWith("1 corners refer to a normal that is not among the 2 in the file; left out"));
}

TEST_CASE("OBJ: objects and groups are parts", "[import][obj]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.obj",
                     kVertices +
                         "f 1 2 3\ng bolt\nf 1 2 3\no pump\nf 1 2 3\ng rotor\nf 1 2 3\ng pump\nf 1 2 3\n"
                         "g rotor\nf 1 2 3\no\nf 1 2 3\n",
                     sink) == "");
  CHECK(sink.parts == std::vector<std::string>{"bolt", "pump", "pump/rotor"});
  const std::vector<uint32_t> expected{kNoIndex, 0, 1, 2, 1, 2, kNoIndex};
  for (size_t i = 0; i < expected.size(); ++i) CHECK(sink.polygons[i].part == expected[i]);
}

TEST_CASE("OBJ: materials, before or after their library, with odd names and paths", "[import][obj]") {
  const TemporaryFolder folder;
  folder.Write("with space.mtl", "newmtl red one \nKd 1 0 0\n");
  folder.Write("b.mtl", "newmtl blue\nKd 0 0 1\nnewmtl red one\nKd 0 1 0\n");
  folder.Write("c.mtl", "newmtl late\n");
  const std::string path = folder.Write(
      "a.obj", "mtllib with space.mtl\r\nmtllib C:\\models\\b.mtl missing.mtl\nusemtl late\nmtllib c.mtl\n" +
                   kVertices +
                   "f 1 2 3\nusemtl red one  \nf 1 2 3\nusemtl nope\nf 1 2 3\nusemtl red one\nf 1 2 3\n"
                   "usemtl nope\nf 1 2 3\nusemtl\nf 1 2 3\n");
  RecordingSink sink;
  REQUIRE(ImportModel(path, sink));
  REQUIRE(sink.materials.size() == 2);
  CHECK(sink.materials[0].name == "late");
  CHECK(sink.materials[1].name == "red one");
  CHECK(sink.materials[1].diffuse == glm::vec3(1, 0, 0));
  const std::vector<uint32_t> expected{0, 1, kNoIndex, 1, kNoIndex, kNoIndex};
  for (size_t i = 0; i < expected.size(); ++i) CHECK(sink.polygons[i].material == expected[i]);
  REQUIRE(sink.warnings.size() == 1);  // the material "nope" may be of the file that is missing
  CHECK(sink.warnings[0].find("the material file \"missing.mtl\" is not there") != std::string::npos);
}

TEST_CASE("OBJ: several library names on a line", "[import][obj]") {
  CHECK(SplitLibraryNames("a.mtl b.mtl") == std::vector<std::string>{"a.mtl", "b.mtl"});
  CHECK(SplitLibraryNames("a\\ b.mtl  c d.MTL") == std::vector<std::string>{"a b.mtl", "c d.MTL"});
  CHECK(SplitLibraryNames("plain") == std::vector<std::string>{"plain"});
}

TEST_CASE("OBJ: errors name the line", "[import][obj]") {
  CHECK(ErrorOf("a.obj", "v 0 0\n") == "a.obj, line 1: a vertex needs three numbers");
  CHECK(ErrorOf("a.obj", "v 0 zero 0\n") == "a.obj, line 1: \"zero\" is not a number");
  CHECK(ErrorOf("a.obj", "vn 0 0\n") == "a.obj, line 1: a normal needs three numbers");
  CHECK(ErrorOf("a.obj", "vt\n") == "a.obj, line 1: a texture coordinate needs a number");
  CHECK(ErrorOf("a.obj", kVertices + "f 0 1 2\n") ==
        "a.obj, line 4: \"0\" in a face refers to vertex 0, but OBJ counts from 1");
  CHECK(ErrorOf("a.obj", kVertices + "f -4 1 2\n") ==
        "a.obj, line 4: \"-4\" in a face reaches before the first vertex of the 3 so far");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2 four\n") == "a.obj, line 4: \"four\" in a face is not an index");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2 3/x\n") == "a.obj, line 4: \"x\" in a face is not an index");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2 3.5\n") ==
        "a.obj, line 4: \".5\" in a face is not part of an index");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2 99999999999999999999\n") ==
        "a.obj, line 4: \"99999999999999999999\" in a face is beyond the 4,294,967,294 elements a file may "
        "have");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2 4\nf 1 2 3\n") ==
        "a.obj, line 4: the face refers to vertex 4, but the file has only 3");
  CHECK(ErrorOf("a.obj", kVertices + "f 1 2\n") == "a.obj: holds no triangles");
  CHECK(ErrorOf("a.obj", std::string(2 << 20, 'x')) ==
        "a.obj, line 1: is longer than 1 MiB, so this is not a text file of a model");
  std::string face = kVertices + "f";
  for (int i = 0; i < 65537; ++i) face += " 1";
  CHECK(ErrorOf("a.obj", face) == "a.obj, line 4: the face has more than 65536 corners");
  CHECK(ErrorOf("a.obj", std::string("ab\0c\n", 5)) ==
        "a.obj, line 1: holds a zero byte, so this is not a text file of a model");
}

TEST_CASE("OBJ: lines across the buffer's end stay whole", "[import][obj]") {
  std::string text = kVertices;
  for (int i = 0; i < 200000; ++i) text += "f 1 2 3" + std::string(static_cast<size_t>(i % 7), ' ') + "\n";
  RecordingSink sink;
  REQUIRE(ImportText("a.obj", text, sink) == "");
  CHECK(sink.triangles == 200000);
}

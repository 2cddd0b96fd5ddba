// Files from reports about other programs, whose readers refuse them or read them wrongly.
#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <string>

#include "preprocess/import/foreign/foreign_content.h"
#include "preprocess/import/origin_survey.h"
#include "tests/unit/recording_sink.h"

namespace quarry {
namespace {

using Catch::Contains;

const std::string kFacet =
    "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 1 1 0\nendloop\nendfacet\n";
const std::string kObj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

std::string WithCr(std::string text) {
  for (char& c : text)
    if (c == '\n') c = '\r';
  return text;
}

uint64_t TrianglesOf(const std::string& name, const std::string& content) {
  RecordingSink sink;
  REQUIRE(ImportText(name, content, sink) == "");
  return sink.triangles;
}

/// Two facets with these attributes.
std::string Stl(std::string header, uint32_t count, uint16_t first, uint16_t second) {
  header.resize(80, ' ');
  header.append(reinterpret_cast<const char*>(&count), 4);
  for (const uint16_t attributes : {first, second}) {
    const float facet[12] = {0, 0, 1, 0, 0, 0, 1, 0, 0, attributes == first ? 1.f : 0.f, 1, 0};
    header.append(reinterpret_cast<const char*>(facet), 48);
    header.append(reinterpret_cast<const char*>(&attributes), 2);
  }
  return header;
}

std::vector<uint32_t> FaceColors(const std::string& name, const std::string& content) {
  RecordingSink sink;
  REQUIRE(ImportText(name, content, sink) == "");
  std::vector<uint32_t> colors;
  for (const auto& polygon : sink.polygons) colors.push_back(Packed(polygon.color));
  return colors;
}

constexpr uint32_t kRed = 0xFF0000FFu, kGreen = 0xFF00FF00u, kWhite = 0xFFFFFFFFu;

}  // namespace

TEST_CASE("Lines may end in CR", "[import][reported]") {
  CHECK(TrianglesOf("a.obj", WithCr("# old\n" + kObj + "f 1 2 3 4\n")) == 2);
  CHECK(TrianglesOf("a.obj", WithCr(kObj) + "f 1 2 3 4\r\nf 1 2 3\n") == 3);
  CHECK(TrianglesOf("a.stl", WithCr("solid s\n" + kFacet + "endsolid s\n")) == 1);
  CHECK(TrianglesOf("a.off", WithCr("OFF\n4 1 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n")) == 2);
  std::string large = "# many lines, more than a buffer holds\n" + kObj;
  for (int i = 0; i < 200000; ++i) large += "f 1 2 3\n";
  CHECK(TrianglesOf("a.obj", WithCr(large)) == 200000);
}

TEST_CASE("OBJ: continuations, names and comments", "[import][reported]") {
  CHECK(TrianglesOf("a.obj", kObj + "f 1 2 \\ \t\n 3 4\n") == 2);
  RecordingSink sink;
  REQUIRE(ImportText("a.obj", kObj + "g C:\\parts\\\nf 1 2 3\ng two # the second\nf 1 2 3\ng #3\nf 1 3 4\n",
                     sink) == "");
  CHECK(sink.parts == std::vector<std::string>{"C:\\\\parts\\\\", "two", "#3"});
}

TEST_CASE("OBJ: colours to 1 and to 255, with alpha", "[import][reported]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.obj", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0 1\nv 1 1 0 255 128 0\nv 0 1 0 1 1 1\nf 1 2 3 4\n",
                     sink) == "");
  CHECK(Packed(sink.colors[0]) == kRed);
  CHECK(Packed(sink.colors[1]) == kGreen);
  CHECK(int{sink.colors[2].g} == 55);
  CHECK(int{sink.colors[3].r} == 0);  // of 255, since the vertex before it is
}

TEST_CASE("STL: words apart, glued, and more of them", "[import][reported]") {
  std::string apart = kFacet;
  apart.replace(apart.find("endloop"), 7, "end loop");
  apart.replace(apart.find("endfacet"), 8, "end facet color 31744");
  CHECK(TrianglesOf("a.stl", "# a comment\n\nsolid\n" + apart + "endsolidname\n") == 1);
  CHECK_THAT(ErrorOf("a.stl", "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0,5 0 0\n"),
             Contains("line 4: ") && Contains("\"0,5\""));
}

TEST_CASE("STL: counts that were never filled in, and lengths behind facets", "[import][reported]") {
  for (const uint32_t count : {0u, 0xFFFFFFFFu}) {
    RecordingSink sink;
    REQUIRE(ImportText("a.stl", Stl("x", count, 0, 0), sink) == "");
    CHECK(sink.triangles == 2);
    CHECK(sink.warnings.size() == 1);
  }
  CHECK_THAT(ErrorOf("a.stl", Stl("x", 0, 0, 0) + "?"), Contains("count of facets is 0"));
  std::string payload = Stl("x", 2, 4, 3) + "abc";
  payload.insert(84 + 50, "abcd");
  RecordingSink sink;
  REQUIRE(ImportText("a.stl", payload, sink) == "");
  CHECK(sink.positions[3] == glm::dvec3(0));
  REQUIRE(sink.warnings.size() == 1);
  CHECK_THAT(sink.warnings[0], Contains("attributes of facets that are not colours"));
}

TEST_CASE("Faces and facets have colours", "[import][reported]") {
  using Colors = std::vector<uint32_t>;
  CHECK(FaceColors("a.stl", Stl("VisCAM", 2, 0xFC00, 0x83E0)) == Colors{kRed, kGreen});
  CHECK(FaceColors("a.stl", Stl("VisCAM", 2, 0x7FFF, 0x000C)) == Colors{kWhite, kWhite});
  CHECK(FaceColors("a.stl", Stl(std::string("COLOR=\0\xFF\0\xFF", 10), 2, 0x001F, 0x8000)) ==
        Colors{kRed, kGreen});
  const std::string off = " 3 2 0\n0 0 0\n1 0 0\n1 1 0\n3 0 1 2 255 0 0\n3 0 1 2\n";
  CHECK(FaceColors("a.off", "OFF" + off) == Colors{kRed, kWhite});
  CHECK(FaceColors("a.off", "OFF3 2 0\n0 0 0\n1 0 0\n1 1 0\n3 0\n1 2 0.0 1.0 0.0\n3 0 1 2\n") ==
        Colors{kGreen, kWhite});
  const std::string head =
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
  const std::string face =
      "element face 1\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar "
      "green\nproperty uchar blue\nend_header\n";
  CHECK(FaceColors("a.ply", head + face + "0 0 0\n1 0 0\n0 1 0\n3 0 1 2 0 255 0\n") == Colors{kGreen});
  const std::string colors = "property float r\nproperty float g\nproperty float b\n";
  CHECK(FaceColors("a.ply",
                   head + colors + face + "0 0 0 1 0 0\n1 0 0 1 0 0\n0 1 0 1 0 0\n3 0 1 2 0 255 0\n") ==
        Colors{kWhite});
}

TEST_CASE("PLY: lines with more values than the header names", "[import][reported]") {
  RecordingSink sink;
  REQUIRE(ImportText(
              "a.ply",
              "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
              "z\nelement face 1\n"
              "property list uchar int vertex_indices\nend_header\n0 0 0 9 9 9\n1\n0 0\n0 1 0\n3 0 1 2 7\n",
              sink) == "");
  CHECK(sink.positions[1] == glm::dvec3(1, 0, 0));
  REQUIRE(sink.warnings.size() == 1);
  CHECK_THAT(sink.warnings[0], Contains("2 lines hold more values"));
}

TEST_CASE("Files that are not models are named", "[import][reported]") {
  const std::pair<std::string, std::string> files[] = {
      {"version https://git-lfs.github.com/spec/v1\noid sha256:00\n", "Git LFS"},
      {std::string("\xFD\x37zXZ\0", 6), "xz"},
      {"PK\3\4....", "zip"},
      {"#usda 1.0\n", "USD"},
      {"PXR-USDC....", "USD"},
      {"Ogawa\xFF", "Alembic"},
      {"LASF....", "point cloud"},
      {"# vtk DataFile Version 3.0\n", "VTK"},
      {"<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\">", "VTK"},
      {"BLENDER-v300", "Blender"},
      {"ISO-10303-21;\nHEADER;FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));", "STEP"},
      {"ISO-10303-21;\nHEADER;FILE_SCHEMA(('IFC4'));", "IFC"},
      {"7z\xBC\xAF\x27\x1C", "7z"},
      {"Rar!\x1A\x07\x01", "RAR"},
      {"BZh91AY&SY", "bzip2"},
      {"QUARRY\r\n", "scene store"},
      {"<!doctype HTML>", "web page"}};
  for (const auto& [content, what] : files)
    for (const char* name : {"a.obj", "a.ply", "a.bin"}) {
      const std::string told = ErrorOf(name, content);
      CHECK_THAT(told, Contains(what) && Contains("; "));
      CHECK(told.find(name) == told.rfind(name));
    }
  CHECK(RecognizeForeign("PK\3\4", ".3mf").what.empty());
  CHECK_THAT(ErrorOf("a.ply",
                     "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty "
                     "float z\nend_header\n0 0 0\n"),
             Contains("point cloud"));
  CHECK_THAT(ErrorOf("a.obj", kObj), Contains("point cloud"));
}

TEST_CASE("The origin is chosen in the middle of the used vertices", "[import][reported]") {
  OriginSurvey survey;
  CHECK(!survey.Place());
  REQUIRE(survey.AddPosition({1e9, 0, 0}, {}));
  CHECK(survey.Place() == glm::dvec3(1e9, 0, 0));
  REQUIRE(survey.AddPosition({NAN, 0, 0}, {}));
  const auto triangle = [&](double x, double size) {
    Corner corners[3];
    for (uint32_t k = 0; k < 3; ++k) corners[k].position = (x > 0 ? 5 : 2) + k;
    for (const glm::dvec3& p : {glm::dvec3(x, 0, 0), {x + size, 0, 0}, {x, size, 0}})
      REQUIRE(survey.AddPosition(p, {}));
    REQUIRE(survey.AddPolygon(corners, 0, 0));
  };
  triangle(-5e6, 1);
  CHECK(survey.Place()->x == Approx(-5e6));
  triangle(5e6, 0.01);  // the smaller one
  CHECK(survey.Place()->x == Approx(5e6));
}

}  // namespace quarry

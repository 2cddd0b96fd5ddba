#include <catch2/catch.hpp>
#include <cstring>

#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

std::string BinaryStl(const std::string& title, uint32_t promised, uint32_t facets) {
  std::string bytes = title + std::string(80 - title.size(), '\0');
  const auto put = [&](auto value) {
    char raw[sizeof value];
    std::memcpy(raw, &value, sizeof value);
    bytes.append(raw, sizeof value);
  };
  put(promised);
  for (uint32_t i = 0; i < facets; ++i) {
    for (int k = 0; k < 12; ++k) put(static_cast<float>(i * 12 + static_cast<uint32_t>(k)));
    put(uint16_t{0});
  }
  return bytes;
}

const std::string kFacet =
    "facet normal 0 0 1\n outer loop\n vertex 0 0 0\n vertex 1 0 0\n vertex 0 1 0\n endloop\nendfacet\n";

}  // namespace

TEST_CASE("STL: binary, even if its header begins with solid", "[import][stl]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.stl", BinaryStl("solid but binary", 2, 2), sink) == "");
  CHECK(sink.triangles == 2);
  CHECK(sink.positions.size() == 6);
  CHECK(sink.positions[3] == glm::dvec3(15, 16, 17));
  CHECK(sink.polygons[1].corners[0].position == 3);
  CHECK(sink.warnings.empty());
}

TEST_CASE("STL: binary with bytes behind the facets is read with a warning", "[import][stl]") {
  RecordingSink sink;
  REQUIRE(ImportText("a.stl", BinaryStl("solid x", 1, 1) + "tail", sink) == "");
  CHECK(sink.triangles == 1);
  REQUIRE(sink.warnings.size() == 1);
  CHECK(sink.warnings[0].find("4 bytes behind the last facet left out") != std::string::npos);
}

TEST_CASE("STL: solids with names are parts; case and lines do not matter", "[import][stl]") {
  RecordingSink sink;
  std::string one_line = kFacet;
  for (char& c : one_line) c = c == '\n' ? ' ' : static_cast<char>(std::toupper(c));
  REQUIRE(ImportText("a.stl",
                     "\xEF\xBB\xBFsolid the valve\r\n" + kFacet + "endsolid the valve\nSOLID\n" + one_line +
                         "\nendsolid\n",
                     sink) == "");
  CHECK(sink.triangles == 2);
  CHECK(sink.parts == std::vector<std::string>{"the valve"});
  CHECK(sink.polygons[0].part == 0);
  CHECK(sink.polygons[1].part == kNoIndex);
}

TEST_CASE("STL: errors name the place", "[import][stl]") {
  CHECK(ErrorOf("a.stl", "") == "a.stl: is empty");
  CHECK(ErrorOf("a.stl", "hello") ==
        "a.stl: is not an ASCII STL, and as a binary STL it would need 84 bytes, but it has 5");
  CHECK(ErrorOf("a.stl", BinaryStl("x", 3, 2)) ==
        "a.stl: is not an ASCII STL, and as a binary STL it would need 234 bytes, but it has 184");
  CHECK(ErrorOf("a.stl", "solid\nhello\n") == "a.stl, line 2: \"hello\" is not a word of an ASCII STL");
  CHECK(ErrorOf("a.stl", "solid\nfacet\nvertex 0 0\n") == "a.stl, line 3: a vertex needs three numbers");
  CHECK(ErrorOf("a.stl", "solid\nvertex 0 0 0\n") == "a.stl, line 2: a vertex stands outside of any facet");
  CHECK(ErrorOf("a.stl", "solid\nfacet\nendfacet\n") == "a.stl, line 3: the facet has 0 corners");
  CHECK(ErrorOf("a.stl", "solid\nfacet\nfacet\n") == "a.stl, line 3: a facet begins within another");
  CHECK(ErrorOf("a.stl", "solid\n" + kFacet + "facet\nvertex 0 0 0\n") ==
        "a.stl, line 11: the file ends within a facet");
  CHECK(ErrorOf("a.stl", "solid\nendsolid\n") == "a.stl: holds no triangles");
  CHECK(ErrorOf("a.stl", BinaryStl("x", 0, 0)) == "a.stl: holds no triangles");
}

TEST_CASE("The format is chosen by content before the extension", "[import]") {
  const std::string obj = "# hello\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  CHECK(ErrorOf("a.stl", obj) == "");
  CHECK(ErrorOf("a.ply", obj) == "");
  CHECK(ErrorOf("a", obj) == "");
  CHECK(ErrorOf("a.obj", BinaryStl("x", 1, 1)) == "");
  CHECK(ErrorOf("a.dat", "hello world") ==
        "a.dat: is neither PLY, OBJ, STL, OFF, NFF, AFF, glTF nor 3MF, the formats that are read");
  RecordingSink sink;
  CHECK(ImportModel("/nowhere/a.obj", sink).error().message ==
        "/nowhere/a.obj: cannot be opened: No such file or directory");
  CHECK(ImportModel("/", sink).error().message == "/: is not a regular file");
}

TEST_CASE("STL: many facets are read in chunks, by any number of threads alike", "[import][stl]") {
  constexpr uint32_t kFacets = 50000;
  std::string bytes = BinaryStl("many", kFacets, kFacets);
  for (uint32_t i = 0; i < kFacets; ++i) bytes[84 + 50 * i + 48] = i % 3 == 0 ? '\x1F' : '\0';
  for (uint32_t i = 0; i < kFacets; ++i) bytes[84 + 50 * i + 49] = i % 3 == 0 ? '\x80' : '\0';  // VisCAM
  WorkTeam team(3);
  for (WorkTeam* helpers : {static_cast<WorkTeam*>(nullptr), &team}) {
    RecordingSink sink;
    sink.helpers = helpers;
    REQUIRE(ImportText("a.stl", bytes, sink) == "");
    REQUIRE(sink.positions.size() == 3 * kFacets);
    REQUIRE(sink.polygons.size() == kFacets);
    size_t wrong = 0;
    for (uint32_t i = 0; i < kFacets; ++i) {
      const RecordingSink::Polygon& facet = sink.polygons[i];
      wrong += facet.color.b != 255 || facet.color.r != (i % 3 == 0 ? 0 : 255);
      for (uint32_t k = 0; k < 3; ++k) {
        wrong += facet.corners[k].position != 3 * i + k;
        wrong += sink.positions[3 * i + k].x != static_cast<float>(12 * i + 3 * (k + 1));
      }
    }
    CHECK(wrong == 0);
    CHECK(sink.warnings.empty());
  }
  RecordingSink sink;
  sink.helpers = &team;
  const std::string error = ImportText("a.stl", bytes.substr(0, 84 + 50 * 40000 + 7), sink);
  CHECK(error.find("it would need 2500084 bytes, but it has 2000091") != std::string::npos);
}

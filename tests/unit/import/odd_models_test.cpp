// Files of other parsers' test suites, and real models; kept outside the project.

#include <catch2/catch.hpp>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>

#include "tests/support/skip.h"
#include "tests/unit/recording_sink.h"

using namespace quarry;
namespace fs = std::filesystem;

namespace {

/// The folder of test scenes; none if this machine has none.
std::optional<fs::path> ScenesFolder() {
  fs::path folder;
#ifdef QUARRY_SCENES_DIR
  folder = QUARRY_SCENES_DIR;
#endif
  if (const char* set = std::getenv("QUARRY_TEST_SCENES")) folder = set;
  std::error_code ignored;
  if (!folder.empty() && fs::is_directory(folder, ignored)) return folder;
  test::Skip("the folder of test scenes is not there; QUARRY_TEST_SCENES names it");
  return std::nullopt;
}

struct Expectation {
  std::string error;       ///< Text that its sentence must contain; empty if the file is to be read.
  uint64_t triangles = 0;  ///< Where the table's script counts otherwise.
};

const std::string kEmpty = "holds no triangles";

/// Files that differ from the table's counts, and why.
const std::map<std::string, Expectation> kDifferent = {
    // No polygons at all: broken text, lines, points, faces of one or two corners.
    {"slicertestmodels/broken/empty_file.stl", {": is empty"}},
    {"slicertestmodels/broken/invalid_stl_ascii.stl", {", line 2: \"Ha,\" is not a word of an ASCII STL"}},
    {"slicertestmodels/broken/random_bits.stl", {"is not an ASCII STL, and as a binary STL it would need"}},
    {"slicertestmodels/broken/text_file.stl", {"is not an ASCII STL, and as a binary STL it would need"}},
    {"slicertestmodels/broken/random_bits.obj", {"holds a zero byte"}},
    {"tinyobjloader/invalid-face-definition.obj", {kEmpty}},
    {"tinyobjloader/issue-356-leading-spaces-newmtl.obj", {kEmpty}},
    {"tinyobjloader/line-prim.obj", {kEmpty}},
    {"tinyobjloader/points-prim.obj", {kEmpty}},
    {"tobj/lines.obj", {kEmpty}},
    // Faces that refer to absent vertices or coordinates.
    {"tinyobjloader/invalid-relative-texture-index.obj",
     {", line 2: \"-2\" in a face reaches before the first"}},
    {"tinyobjloader/invalid-relative-vertex-index.obj",
     {", line 1: \"-4\" in a face reaches before the first"}},
    {"tinyobjloader/issue-140-zero-face-idx.obj", {", line 16: \"0/0/0\" in a face refers to vertex 0"}},
    {"tobj/invalid_index.obj", {", line 12: the face refers to vertex 7, but the file has only 6"}},
    // The last facet has four corners, which the script takes for one triangle.
    {"slicertestmodels/broken/cube_and_plane.stl", {"", 14}},
    // The script wants "facet normal", which this file leaves out.
    {"slicertestmodels/broken/vertical_line.stl", {"", 1}},
    // The script passes over triangle strips.
    {"tinyply/elephant.ply", {"", 39290}},
};

struct Row {
  std::string path, format;
  uint64_t triangles;
};

std::vector<Row> ReadTable(const fs::path& path) {
  std::vector<Row> rows;
  std::ifstream in(path);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::vector<std::string> cells;
    std::istringstream split(line);
    for (std::string cell; std::getline(split, cell, '\t');) cells.push_back(cell);
    if (cells.size() >= 7 && !cells[6].empty()) rows.push_back({cells[0], cells[3], std::stoull(cells[6])});
  }
  return rows;
}

void CheckModel(const fs::path& scenes, const std::string& path, uint64_t triangles) {
  CAPTURE(path);
  RecordingSink sink;
  const Status status = ImportModel((scenes / path).string(), sink);
  CHECK((status ? "" : status.error().message) == "");
  CHECK(sink.triangles == triangles);
}

}  // namespace

TEST_CASE("Odd files are read, or refused with the reason", "[import][odd]") {
  const auto scenes = ScenesFolder();
  if (!scenes) return;
  const std::vector<Row> rows = ReadTable(*scenes / "odd/MEASURED.tsv");
  REQUIRE(rows.size() > 90);
  for (const Row& row : rows) {
    const auto different = kDifferent.find(row.path);
    if (different == kDifferent.end()) {
      CheckModel(*scenes / "odd", row.path, row.triangles);
      continue;
    }
    if (different->second.error.empty()) {
      CheckModel(*scenes / "odd", row.path, different->second.triangles);
      continue;
    }
    RecordingSink sink;
    const Status status = ImportModel((*scenes / "odd" / row.path).string(), sink);
    CAPTURE(row.path);
    CHECK(!status);
    if (!status) CHECK_THAT(status.error().message, Catch::Contains(different->second.error));
  }
}

TEST_CASE("Odd glTF and OFF files are read, or refused with the reason", "[import][odd]") {
  const auto scenes = ScenesFolder();
  if (!scenes) return;
  const std::map<std::string, Expectation> files = {
      {"slicertestmodels/off/cube.off", {"", 12}},
      {"tinygltf/BoundsChecking/integer-out-of-bounds.gltf", {"byteLength is not a whole number"}},
      // No scene shows these meshes.
      {"tinygltf/BoundsChecking/invalid-buffer-index.gltf", {kEmpty}},
      {"tinygltf/BoundsChecking/invalid-buffer-view-index.gltf", {kEmpty}},
      {"tinygltf/BoundsChecking/invalid-primitive-indices.gltf", {kEmpty}},
      {"tinygltf/Cube/Cube.gltf", {"", 12}},
      {"tinygltf/Cube-texture-ext/Cube-textransform.gltf", {"", 12}},
      {"tinygltf/CubeImageUriSpaces/CubeImageUriSpaces.gltf", {"", 12}},
      {"tinygltf/CubeImageUriSpaces/CubeImageUriMultipleSpaces.gltf", {"", 12}},
      {"tinygltf/Extensions-issue97/test.gltf", {"", 1}},
      {"tinygltf/Extensions-overwrite-issue261/issue-261.gltf", {"", 12}},
      {"tinygltf/SparseMorphTargets-issue280/singleBlendshapeCube_sparse.glb", {"", 12}},
      {"tinygltf/regression/unassigned-skeleton.gltf", {"", 8}},
      {"tinygltf/regression/zero-sized-bin-chunk-issue-440.glb", {"", 1}},
      {"tinygltf/box01.glb", {"", 12}},
  };
  for (const auto& [path, expected] : files) {
    if (expected.error.empty()) {
      CheckModel(*scenes / "odd", path, expected.triangles);
      continue;
    }
    CAPTURE(path);
    RecordingSink sink;
    const Status status = ImportModel((*scenes / "odd" / path).string(), sink);
    REQUIRE(!status);
    CHECK_THAT(status.error().message, Catch::Contains(expected.error));
  }
}

TEST_CASE("Real models have their known number of triangles", "[import][real]") {
  const auto scenes = ScenesFolder();
  if (!scenes) return;
  CheckModel(*scenes, "bunny/bun_zipper.ply", 69451);
  CheckModel(*scenes, "dragon/dragon_vrip_res2.ply", 202520);
  CheckModel(*scenes, "conference/conference_geometry.ply", 331179);
  CheckModel(*scenes, "sibenik/sibenik.obj", 75284);
  CheckModel(*scenes, "sibenik/sibenik_geometry.ply", 75284);
  CheckModel(*scenes, "sponza_crytek/sponza.obj", 279163);
  CheckModel(*scenes, "cornell/CornellBox-Original.obj", 36);
}

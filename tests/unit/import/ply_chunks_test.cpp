// Binary PLY is read in chunks of rows by several threads; text is read row by row. Both give the same.

#include <fmt/format.h>

#include <catch2/catch.hpp>
#include <cstring>
#include <functional>

#include "tests/unit/recording_sink.h"

using namespace quarry;

namespace {

constexpr uint32_t kVertices = 40000, kFaces = 60000;

template <typename T>
void Put(std::string& bytes, T value) {
  char raw[sizeof value];
  std::memcpy(raw, &value, sizeof value);
  bytes.append(raw, sizeof value);
}

/// A model of triangles, with other polygons here and there, as text or binary. `corner_of`: an index.
std::string Model(bool binary, const std::function<int32_t(uint32_t face, uint32_t corner)>& corner_of) {
  std::string bytes = fmt::format(
      "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property float nx\nproperty float ny\nproperty float nz\nproperty float u\nproperty float v\n"
      "element face {}\nproperty list uchar int vertex_indices\nproperty uchar red\nproperty uchar green\n"
      "property uchar blue\nend_header\n",
      binary ? "binary_little_endian" : "ascii", kVertices, kFaces);
  for (uint32_t i = 0; i < kVertices; ++i) {
    const float values[] = {static_cast<float>(i),           0.5f, static_cast<float>(i % 7), 0, 0, 1,
                            static_cast<float>(i % 16) / 16, 0.25f};
    for (const float value : values)
      if (binary)
        Put(bytes, value);
      else
        bytes += fmt::format("{} ", value);
    if (!binary) bytes += '\n';
  }
  for (uint32_t face = 0; face < kFaces; ++face) {
    // Alone, in rows, and far apart.
    const uint32_t corners = face % 5003 == 9 || face / 10 == 777 ? 4 : face == 30000 ? 2 : 3;
    const int colors[] = {static_cast<int>(face % 256), 255, 9};
    if (binary) {
      Put(bytes, static_cast<uint8_t>(corners));
      for (uint32_t k = 0; k < corners; ++k) Put(bytes, corner_of(face, k));
      for (const int color : colors) Put(bytes, static_cast<uint8_t>(color));
    } else {
      bytes += fmt::format("{}", corners);
      for (uint32_t k = 0; k < corners; ++k) bytes += fmt::format(" {}", corner_of(face, k));
      bytes += fmt::format(" {} {} {}\n", colors[0], colors[1], colors[2]);
    }
  }
  return bytes;
}

int32_t Usual(uint32_t face, uint32_t corner) {
  return static_cast<int32_t>((face * 7 + corner * 11) % kVertices);
}

size_t Differences(const RecordingSink& a, const RecordingSink& b) {
  size_t differences = 0;
  for (size_t i = 0; i < a.polygons.size(); ++i) {
    const RecordingSink::Polygon &p = a.polygons[i], &q = b.polygons[i];
    differences += p.corners.size() != q.corners.size() || Packed(p.color) != Packed(q.color) ||
                   p.material != q.material || p.part != q.part;
    for (size_t k = 0; k < std::min(p.corners.size(), q.corners.size()); ++k) {
      const Corner &c = p.corners[k], &d = q.corners[k];
      differences += c.position != d.position || c.normal != d.normal || c.uv != d.uv;
    }
  }
  return differences;
}

}  // namespace

TEST_CASE("PLY: chunks give what single rows give, by any number of threads", "[import][ply]") {
  RecordingSink rows;
  REQUIRE(ImportText("a.ply", Model(false, Usual), rows) == "");
  REQUIRE(rows.polygons.size() == kFaces - 1);
  const std::string binary = Model(true, Usual);
  WorkTeam team(3);
  for (WorkTeam* helpers : {static_cast<WorkTeam*>(nullptr), &team}) {
    RecordingSink chunks;
    chunks.helpers = helpers;
    REQUIRE(ImportText("a.ply", binary, chunks) == "");
    CHECK(chunks.positions == rows.positions);
    CHECK(chunks.normals == rows.normals);
    CHECK(chunks.uvs == rows.uvs);
    REQUIRE(chunks.polygons.size() == rows.polygons.size());
    CHECK(Differences(chunks, rows) == 0);
    CHECK(chunks.warnings.size() == rows.warnings.size());
  }
}

TEST_CASE("PLY: of several faults in a chunk the first is named", "[import][ply]") {
  const uint32_t faults[] = {45123, 45124, 46999, 52001};
  const std::string binary = Model(true, [&](uint32_t face, uint32_t corner) {
    const bool bad = std::ranges::find(faults, face) != std::end(faults);
    return bad && corner == 1 ? (face % 2 == 0 ? -1 : int32_t{kVertices}) : Usual(face, corner);
  });
  WorkTeam team(3);
  RecordingSink sink;
  sink.helpers = &team;
  const std::string error = ImportText("a.ply", binary, sink);
  CHECK(error.find("face 45123 (counted from 0) refers to vertex 40000, but there are 40000") !=
        std::string::npos);
  CHECK(sink.polygons.size() == 45123 - 1);
}

TEST_CASE("PLY: a file that ends within a row of a chunk says where", "[import][ply]") {
  const std::string binary = Model(true, Usual);
  WorkTeam team(3);
  RecordingSink sink;
  sink.helpers = &team;
  const std::string error = ImportText("a.ply", binary.substr(0, binary.size() - 17), sink);
  CHECK(error.find(fmt::format("the file ends in face {} (counted from 0)", kFaces - 2)) !=
        std::string::npos);
}

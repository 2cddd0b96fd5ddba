#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <glm/geometric.hpp>
#include <map>
#include <random>
#include <tuple>

#include "common/math/packed_normal.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_reader.h"
#include "preprocess/preprocess.h"
#include "preprocess/smooth/corner_fans.h"
#include "preprocess/smooth/smooth_region.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

/// Normals by triangle and corner. Flat corners are absent.
using Normals = std::map<std::pair<uint32_t, uint32_t>, glm::vec3>;

Normals SolveAll(const std::vector<TriangleRecord>& triangles, double crease) {
  CornerFans fans(crease);
  for (uint32_t i = 0; i < triangles.size(); ++i)
    for (uint32_t k = 0; k < 3 && IsSmoothed(triangles[i]); ++k)
      fans.Add(triangles[i], i, k, HashOfPosition(triangles[i].vertices[k]));
  Normals normals;
  for (const CornerNormal& n : fans.Solve()) normals[{n.triangle, n.corner}] = UnpackNormal(n.normal);
  return normals;
}

/// Of triangles with some normals, the other corners have the facet's, as in a store.
Normals WithFacets(Normals normals, const std::vector<TriangleRecord>& triangles) {
  for (const auto& [place, normal] : Normals(normals))
    for (uint32_t k = 0; k < 3; ++k)
      normals.emplace(std::pair(place.first, k),
                      UnpackNormal(PackNormal(FacetNormal(triangles[place.first]))));
  return normals;
}

void AddQuad(std::vector<TriangleRecord>& to, const glm::vec3& a, const glm::vec3& b, const glm::vec3& c,
             const glm::vec3& d) {
  for (const auto& [p, q, r] : {std::tuple(a, b, c), std::tuple(a, c, d)}) {
    TriangleRecord t;
    t.vertices[0] = p;
    t.vertices[1] = q;
    t.vertices[2] = r;
    t.id = static_cast<uint32_t>(to.size());
    if (FaultOf(t) == TriangleFault::kNone) to.push_back(t);
  }
}

/// A ball of radius 1 of 2 * n * n quads.
std::vector<TriangleRecord> Ball(int n) {
  std::vector<TriangleRecord> ball;
  const auto at = [&](int i, int j) {
    if (i == n) return glm::vec3(0, 0, -1);  // sin(pi) is not 0
    const double u = M_PI * i / n, v = M_PI * (j % (2 * n)) / n;
    return glm::vec3(glm::dvec3(std::sin(u) * std::cos(v), std::sin(u) * std::sin(v), std::cos(u)));
  };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < 2 * n; ++j) AddQuad(ball, at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  return ball;
}

std::vector<TriangleRecord> Cube() {
  std::vector<TriangleRecord> cube;
  const glm::vec3 o(0), x(1, 0, 0), y(0, 1, 0), z(0, 0, 1);
  AddQuad(cube, o, y, x + y, x);
  AddQuad(cube, z, x + z, x + y + z, y + z);
  AddQuad(cube, o, x, x + z, z);
  AddQuad(cube, y, y + z, x + y + z, x + y);
  AddQuad(cube, o, z, y + z, y);
  AddQuad(cube, x, x + y, x + y + z, x + z);
  return cube;
}

float Degrees(const glm::vec3& a, const glm::vec3& b) {
  const glm::dvec3 x = glm::normalize(glm::dvec3(a)), y = glm::normalize(glm::dvec3(b));
  return static_cast<float>(std::atan2(glm::length(glm::cross(x, y)), glm::dot(x, y)) * 57.29578);
}

std::string WriteObj(const TemporaryFolder& folder, const std::vector<TriangleRecord>& triangles) {
  const std::string path = folder.file("m.obj");
  std::ofstream out(path);
  out.precision(9);
  for (const TriangleRecord& t : triangles) {
    for (const glm::vec3& v : t.vertices) out << "v " << v.x << ' ' << v.y << ' ' << v.z << '\n';
    out << "f -3 -2 -1\n";
  }
  return path;
}

/// The normals that a store of the model has.
Normals StoredNormals(const PreprocessOptions& options, uint32_t* version = nullptr) {
  REQUIRE(Preprocess(options).has_value());
  const auto store = StoreReader::Open(options.output);
  REQUIRE(store.has_value());
  REQUIRE(store->Verify([](auto&&...) {}).has_value());
  const Catalog& catalog = store->catalog();
  Normals normals;
  BlockDecoder decoder;
  for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
    const auto& blocks = catalog.voxels[v].blocks;
    if (blocks[1].stored == 0) continue;
    Bytes hot_bytes(blocks[0].decoded + 64), shading_bytes(blocks[1].decoded + 64);
    const auto room = [](Bytes& bytes, size_t size) {
      void* at = bytes.data();
      size_t space = bytes.size();
      return std::span(static_cast<std::byte*>(std::align(16, size, at, space)), size);
    };
    const auto hot_stored = store->ReadBlock(BlockKey::Hot(v));
    const auto stored = store->ReadBlock(BlockKey::Shading(v));
    REQUIRE((hot_stored.has_value() && stored.has_value()));
    const auto hot = DecodeHot(decoder, catalog, v, *hot_stored, room(hot_bytes, blocks[0].decoded));
    REQUIRE(hot.has_value());
    const auto shading = DecodeShading(decoder, catalog, v, *stored, room(shading_bytes, blocks[1].decoded));
    REQUIRE(shading.has_value());
    for (uint32_t t = 0; t < shading->triangle_count; ++t)
      for (uint32_t k = 0; k < 3; ++k)
        if (const glm::vec3& n = shading->vertex(t, static_cast<int>(k)).normal; n != glm::vec3(0)) {
          const auto [at, first] = normals.emplace(std::pair(hot->triangle_ids[t], k), n);
          REQUIRE((first || at->second == n));  // every copy of a triangle has the same
        }
  }
  if (version != nullptr) {
    std::ifstream file(options.output, std::ios::binary);
    file.seekg(8);
    file.read(reinterpret_cast<char*>(version), sizeof *version);
  }
  return normals;
}

PreprocessOptions OptionsFor(const TemporaryFolder& folder, const std::string& model) {
  PreprocessOptions options;
  options.models = {model};
  options.output = folder.file("m.quarry");
  options.threads = 2;
  options.quiet = true;
  return options;
}

}  // namespace

TEST_CASE("A packed normal is near its vector, and is packed to the same again", "[smooth]") {
  std::mt19937 random(7);
  std::normal_distribution<float> coordinate;
  float farthest = 0;
  for (int i = 0; i < 200000; ++i) {
    const glm::vec3 n(coordinate(random), coordinate(random), coordinate(random));
    const uint32_t code = PackNormal(n);
    REQUIRE(code != 0);
    const glm::vec3 unpacked = UnpackNormal(code);
    farthest = std::max(farthest, Degrees(unpacked, n));
    const glm::vec3 again = UnpackNormal(PackNormal(unpacked));
    REQUIRE(std::memcmp(&again, &unpacked, sizeof again) == 0);
  }
  CHECK(farthest < 0.015f);
  for (int a = 0; a < 3; ++a)
    for (const float sign : {-1.0f, 1.0f}) {
      glm::vec3 axis(0);
      axis[a] = sign;
      CHECK(UnpackNormal(PackNormal(axis * 17.0f)) == axis);
    }
  for (uint32_t i = 0; i < 200000; ++i) {  // whatever a damaged store holds
    const glm::vec3 n = UnpackNormal(static_cast<uint32_t>(random()));
    REQUIRE(std::fabs(glm::dot(n, n) - 1) < 1e-5f);
  }
}

TEST_CASE("A ball's corners have the ball's normals, a cube's have none", "[smooth]") {
  const std::vector<TriangleRecord> ball = Ball(48);
  const Normals smooth = SolveAll(ball, 30);
  CHECK(smooth.size() > 3 * ball.size() * 9 / 10);
  for (const auto& [place, normal] : smooth)
    REQUIRE(Degrees(normal, ball[place.first].vertices[place.second]) < 3.75f);
  CHECK(SolveAll(Cube(), 30).empty());
  CHECK(SolveAll(Cube(), 89).empty());
  const Normals round = SolveAll(Cube(), 90);
  CHECK(round.size() == 36);
  for (const auto& [place, normal] : round)
    REQUIRE(Degrees(normal, Cube()[place.first].vertices[place.second] - glm::vec3(0.5f)) < 0.1f);
}

TEST_CASE("Smoothing groups override angles, and sides do not matter without them", "[smooth]") {
  std::vector<TriangleRecord> cube = Cube();
  for (TriangleRecord& t : cube) t.smoothing = SmoothingGroup(1);
  CHECK(SolveAll(cube, 1).size() == 36);
  cube[0].smoothing = cube[1].smoothing = SmoothingGroup(2);  // the lower side is apart
  for (const auto& [place, normal] : SolveAll(cube, 1))
    if (place.first >= 2) CHECK(normal.z > -0.01f);
  CHECK(SolveAll(cube, 1).size() == 30);
  for (TriangleRecord& t : cube) t.smoothing = kFlat;
  CHECK(SolveAll(cube, 180).empty());

  std::vector<TriangleRecord> ball = Ball(48);
  const Normals before = SolveAll(ball, 30);
  for (size_t i = 0; i < ball.size(); i += 3) std::swap(ball[i].vertices[0], ball[i].vertices[1]);
  const Normals turned = SolveAll(ball, 30);
  CHECK(std::fabs(static_cast<double>(turned.size()) / static_cast<double>(before.size()) - 1) < 0.01);
  for (const auto& [place, normal] : turned) {
    const glm::vec3 outwards = ball[place.first].vertices[place.second];
    REQUIRE(Degrees(glm::dot(normal, outwards) < 0 ? -normal : normal, outwards) < 3.75f);
  }
  for (TriangleRecord& t : ball) t.smoothing = kOwnNormals;
  CHECK(SolveAll(ball, 30).empty());
}

TEST_CASE("A fan of very many corners stays flat", "[smooth]") {
  std::vector<TriangleRecord> cone;
  const auto rim = [](int i, int n) {
    return glm::vec3(static_cast<float>(std::cos(2 * M_PI * i / n)),
                     static_cast<float>(std::sin(2 * M_PI * i / n)), 0.0f);
  };
  for (const int n : {400, 600}) {
    cone.clear();
    for (int i = 0; i < n; ++i) {
      TriangleRecord t;
      t.vertices[0] = rim(i, n);
      t.vertices[1] = rim((i + 1) % n, n);
      t.vertices[2] = {0, 0, 3};
      cone.push_back(t);
    }
    CHECK(SolveAll(cone, 60).contains({0, 2}) == (n <= int{CornerFans::kMostAround}));
    CHECK(SolveAll(cone, 60).contains({0, 0}));
  }
}

TEST_CASE("Stores have the normals of the whole model, whatever regions and memory it was built in",
          "[smooth][long]") {
  // 359,400 triangles: more than memory holds at once, so that they are routed to regions.
  const std::vector<TriangleRecord> ball = Ball(300);
  REQUIRE(ball.size() > kMostInMemory);
  const TemporaryFolder folder;
  PreprocessOptions options = OptionsFor(folder, WriteObj(folder, ball));
  uint32_t version = 0;
  const Normals stored = StoredNormals(options, &version);
  CHECK(version == kPackedStoreVersion);
  // The offset moves positions; of a ball about the origin it is zero.
  CHECK(stored == WithFacets(SolveAll(ball, 30), ball));

  const auto bytes = [&] {
    std::ifstream file(options.output, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(file), {});
  };
  const std::string whole = bytes();
  options.memory = 64 << 20;
  options.threads = 1;
  REQUIRE(Preprocess(options).has_value());
  CHECK(bytes() == whole);

  options.crease = 0;
  CHECK(StoredNormals(options, &version).empty());
  CHECK(version == kUnpackedStoreVersion);
}

TEST_CASE("Flat sheets stay flat beside a fold between them", "[smooth]") {
  // Two sheets of strips that meet at x = 0 by 20 degrees.
  std::vector<TriangleRecord> sheets;
  const auto at = [](int strip, float y) {
    const float x = static_cast<float>(strip);
    return glm::vec3(x * 0.98480775f, y, -std::fabs(x) * 0.17364818f);
  };
  for (int strip = -3; strip < 3; ++strip)
    AddQuad(sheets, at(strip, 0), at(strip + 1, 0), at(strip + 1, 1), at(strip, 1));
  const TemporaryFolder folder;
  const Normals stored = StoredNormals(OptionsFor(folder, WriteObj(folder, sheets)));
  CHECK(stored.size() == 12);  // of the four triangles at the fold
  for (const auto& [place, normal] : stored) {
    const TriangleRecord& t = sheets[place.first];
    const bool at_fold = t.vertices[place.second].x == 0;
    CHECK(Degrees(normal, at_fold ? glm::vec3(0, 0, 1) : FacetNormal(t)) < 0.02f);
  }
}

TEST_CASE("Both sides of a sheet in a smoothing group keep their own normals", "[smooth]") {
  std::vector<TriangleRecord> sides = Ball(48);
  const size_t one = sides.size();
  for (size_t i = 0; i < one; ++i) {
    sides.push_back(sides[i]);
    std::swap(sides.back().vertices[0], sides.back().vertices[1]);
  }
  for (TriangleRecord& t : sides) t.smoothing = SmoothingGroup(1);
  const Normals normals = SolveAll(sides, 30);
  CHECK(normals.size() > 3 * one);
  for (const auto& [place, normal] : normals) {
    const glm::vec3& outwards = sides[place.first].vertices[place.second];
    REQUIRE(Degrees(normal, place.first < one ? outwards : -outwards) < 3.75f);
  }
}

TEST_CASE("Groups of equal number in two files are two", "[smooth]") {
  CHECK(SmoothingOfFile(SmoothingGroup(1), 1) != SmoothingOfFile(SmoothingGroup(1), 2));
  CHECK(SmoothingOfFile(SmoothingGroup(1), 3) != SmoothingOfFile(SmoothingGroup(2), 3));
  for (const uint16_t other : {kSmoothByAngle, kFlat, kOwnNormals}) CHECK(SmoothingOfFile(other, 7) == other);
}

TEST_CASE("Smoothing groups, normals and flat facets of a model reach the store", "[smooth]") {
  const TemporaryFolder folder;
  PreprocessOptions options = OptionsFor(folder, folder.file("m.obj"));
  const std::string cube =
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\nvn 0 0 1\n";
  const std::string faces = "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 1 5 8 4\nf 2 3 7 6\n";
  const auto count = [&](const std::string& text) {
    std::ofstream(folder.file("m.obj")) << text;
    return StoredNormals(options).size();
  };
  CHECK(count(cube + faces) == 0);
  CHECK(count(cube + "s 1\n" + faces) == 36);
  options.crease = 100;
  CHECK(count(cube + faces) == 36);
  CHECK(count(cube + "s off\n" + faces) == 0);
  // Triangles of a face with normals keep them, and give others nothing.
  options.crease = 30;
  CHECK(count(cube + "f 5//1 6//1 7//1 8//1\nf 1 2 6 5\n") == 6);
}

TEST_CASE("A region too large for memory gets the same normals through files", "[smooth]") {
  std::vector<TriangleRecord> ball = Ball(300);
  const TemporaryFolder folder;
  const Region whole{{glm::vec3(-1.1f), glm::vec3(1.1f)}};
  const PartitionOptions options{1e-5f, 256 << 10, 16 << 20, folder.file("part-")};
  auto file = SpillFile::Open(folder.file("all"), RecordBytes(Attributes::kNone), 0);
  REQUIRE(file.has_value());
  for (const TriangleRecord& t : ball) REQUIRE(file->Append(&t).has_value());
  REQUIRE(file->FinishWriting().has_value());
  Normals normals;
  REQUIRE(PartitionSmoothed(*file, whole, whole.cell, options, nullptr, 30, [&](const VoxelTask& task) {
            for (const TriangleRecord& t : task.triangles)
              for (uint32_t k = 0; k < 3; ++k)
                if (t.normals[k] != glm::vec3(0)) normals[{t.id, k}] = t.normals[k];
            return Status{};
          }).has_value());
  CHECK(normals == SolveAll(ball, 30));
  size_t left = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder.file("")))
    left += entry.path().filename() != "all" ? 1 : 0;
  CHECK(left == 0);
}

TEST_CASE("Packed shading blocks keep texture coordinates and colours", "[smooth]") {
  std::vector<TriangleRecord> ball = Ball(16);
  ShadingVoxel voxel;
  for (size_t i = 0; i < 40; ++i) {
    ShadingVertex v;
    if (i % 3 != 0) v.normal = UnpackNormal(PackNormal(ball[i].vertices[0]));
    voxel.vertices.push_back(v);
    voxel.corners.insert(voxel.corners.end(), 3, static_cast<uint16_t>(i));
  }
  voxel.packed = true;
  BlockDecoder decoder;
  for (int columns = 0; columns < 4; ++columns) {
    for (size_t i = 0; i < voxel.vertices.size(); ++i) {
      if ((columns & 1) != 0) voxel.vertices[i].uv = {0.25f * static_cast<float>(i), -1};
      voxel.vertices[i].color = (columns & 2) != 0 ? 0xFF000000u + static_cast<uint32_t>(i) : 0xFFFFFFFFu;
    }
    const Bytes stored = CompressBlock(EncodeShading(voxel));
    std::vector<ShadingVertex> out(ShadingBytes(40, 40) / sizeof(ShadingVertex));
    const auto room = std::as_writable_bytes(std::span(out)).first(ShadingBytes(40, 40));
    const auto shading = decoder.Shading(stored, room);
    REQUIRE(shading.has_value());
    for (size_t i = 0; i < 40; ++i) REQUIRE(shading->vertices[i] == voxel.vertices[i]);
    for (size_t cut = 0; cut < stored.size(); ++cut)  // no shorter block is one
      REQUIRE(!decoder.Shading(std::span(stored).first(cut), room).has_value());
  }
}

}  // namespace quarry::test

#include "preprocess/import/nff/nff_shapes.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <span>

#include "preprocess/import/formats.h"

namespace quarry {
namespace {

constexpr uint32_t kMeridians = 24;  // of spheres, cones and cylinders
constexpr uint32_t kParallels = 12;  // of spheres
constexpr uint64_t kTrianglesOfSphere = kMeridians * (2 * kParallels - 2), kTrianglesOfCone = 2 * kMeridians;
// Most triangles of all spheres and cones of a model: a few bytes of text become 528 triangles of about 50
// bytes each on disk. This many take a minute or two and 2.5 GB of spill.
constexpr uint64_t kMostRoundTriangles = 50'000'000;

Status AddPosition(NffFile& file, const glm::dvec3& p) {
  ++file.scene.positions;
  return file.scene.animations_only ? Status{} : file.scene.sink.AddPosition(file.Point(p), {});
}

Status AddNormal(NffFile& file, const glm::dvec3& n) {
  ++file.scene.normals;
  return file.scene.animations_only ? Status{} : file.scene.sink.AddNormal(file.Normal(n));
}

Status AddPolygon(NffFile& file, std::span<const Corner> corners) {
  if (corners.size() < 3 || file.scene.animations_only) return {};
  file.scene.triangles += corners.size() - 2;
  return file.scene.sink.AddPolygon(corners, file.scene.material, file.part);
}

/// The first pass refuses a model with too many before any triangle is made.
Status CountRound(NffFile& file, uint64_t triangles) {
  ++file.scene.round_shapes;
  file.scene.round_triangles += triangles;
  if (file.scene.round_triangles <= kMostRoundTriangles) return {};
  return file.words.FailHere(
      fmt::format("its first {} spheres and cones become {} triangles ({} a sphere, {} a cone), and at most "
                  "{} are made; give a model with fewer, or with meshes instead",
                  file.scene.round_shapes, file.scene.round_triangles, kTrianglesOfSphere, kTrianglesOfCone,
                  kMostRoundTriangles));
}

/// Gives rows of kMeridians points with normals, joined by quads; at a pole a quad becomes a triangle.
template <class At>
Status Grid(NffFile& file, uint32_t rows, At&& at) {
  QUARRY_TRY(CountRound(file, rows > 1 ? kTrianglesOfSphere : kTrianglesOfCone));
  if (file.scene.animations_only) return {};
  const auto first = static_cast<uint32_t>(file.scene.positions),
             first_normal = static_cast<uint32_t>(file.scene.normals);
  for (uint32_t row = 0; row <= rows; ++row)
    for (uint32_t i = 0; i < kMeridians; ++i) {
      const auto [point, normal] = at(row, 2 * std::numbers::pi * i / kMeridians);
      QUARRY_TRY(AddPosition(file, point));
      QUARRY_TRY(AddNormal(file, normal));
    }
  for (uint32_t row = 0; row < rows; ++row)
    for (uint32_t i = 0; i < kMeridians; ++i) {
      const uint32_t next = (i + 1) % kMeridians;
      Corner corners[4];
      uint32_t k = 0;
      for (const uint32_t at_index : {row * kMeridians + i, row * kMeridians + next,
                                      (row + 1) * kMeridians + next, (row + 1) * kMeridians + i})
        corners[k++] = {first + at_index, first_normal + at_index, kNoIndex};
      if (rows > 1 && row == 0) {
        const Corner triangle[] = {corners[0], corners[2], corners[3]};
        QUARRY_TRY(AddPolygon(file, triangle));
      } else if (rows > 1 && row + 1 == rows) {
        QUARRY_TRY(AddPolygon(file, std::span(corners).first(3)));
      } else {
        QUARRY_TRY(AddPolygon(file, corners));
      }
    }
  return {};
}

/// Reads three vertices of each triangle, then three normals and three texture coordinates, as far as the
/// mesh has them.
Status Triangles(NffFile& file, uint32_t count, const uint64_t counts[3], const uint64_t first[3]) {
  for (uint32_t i = 0; i < count; ++i) {
    uint32_t indices[3][3];
    for (int kind = 0; kind < 3; ++kind)
      for (uint32_t& index : indices[kind]) {
        index = kNoIndex;
        if (counts[kind] == 0) continue;
        QUARRY_ASSIGN(const uint32_t at, file.words.Index("an index", counts[kind] - 1));
        index = static_cast<uint32_t>(first[kind] + at);
      }
    Corner corners[3];
    for (int k = 0; k < 3; ++k) corners[k] = {indices[0][k], indices[1][k], indices[2][k]};
    QUARRY_TRY(AddPolygon(file, corners));
  }
  return {};
}

}  // namespace

Status ReadNffPolygon(NffFile& file, bool normals) {
  QUARRY_ASSIGN(const uint32_t count, file.words.Index("the number of corners", kMaxPolygonCorners));
  std::vector<Corner> corners;
  for (uint32_t i = 0; i < count; ++i) {
    corners.push_back({static_cast<uint32_t>(file.scene.positions),
                       normals ? static_cast<uint32_t>(file.scene.normals) : kNoIndex, kNoIndex});
    QUARRY_ASSIGN(const glm::dvec3 p, file.Vec3("a corner"));
    QUARRY_TRY(AddPosition(file, p));
    if (!normals) continue;
    QUARRY_ASSIGN(const glm::dvec3 n, file.Vec3("a normal"));
    QUARRY_TRY(AddNormal(file, n));
  }
  return AddPolygon(file, corners);
}

Status ReadNffSphere(NffFile& file) {
  QUARRY_ASSIGN(const glm::dvec3 center, file.Vec3("a centre"));
  QUARRY_ASSIGN(const double radius, file.words.Number("a radius"));
  return Grid(file, kParallels, [&](uint32_t row, double angle) {
    const double tilt = std::numbers::pi * row / kParallels;
    const glm::dvec3 n(std::sin(tilt) * std::cos(angle), std::sin(tilt) * std::sin(angle), std::cos(tilt));
    return std::pair(center + radius * n, n);
  });
}

/// The cone is open at both ends.
Status ReadNffCone(NffFile& file) {
  glm::dvec3 ends[2];
  double radii[2];
  for (int i = 0; i < 2; ++i) {
    QUARRY_ASSIGN(ends[i], file.Vec3("the end of a cone"));
    QUARRY_ASSIGN(radii[i], file.words.Number("a radius"));
  }
  const glm::dvec3 axis = ends[1] - ends[0];
  const double length = glm::length(axis);
  if (!(length > 0)) return file.words.FailHere("a cone whose ends coincide");
  const glm::dvec3 w = axis / length;
  const glm::dvec3 u =
      glm::normalize(glm::cross(w, std::fabs(w.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0)));
  const glm::dvec3 v = glm::cross(w, u);
  return Grid(file, 1, [&](uint32_t row, double angle) {
    const glm::dvec3 around = std::cos(angle) * u + std::sin(angle) * v;
    return std::pair(ends[row] + radii[row] * around, around * length + w * (radii[0] - radii[1]));
  });
}

Status ReadNffMesh(NffFile& file) {
  uint64_t counts[3] = {0, 0, 0};  // of vertices, normals, texture coordinates
  const uint64_t first[3] = {file.scene.positions, file.scene.normals, file.scene.uvs};
  for (;;) {
    QUARRY_ASSIGN(const std::string kind,
                  file.words.Word("\"vertices\", \"normals\", \"texturecoords\" or \"triangles\""));
    QUARRY_ASSIGN(const uint32_t count, file.words.Index("a count", kMostInMesh));
    if (kind == "triangles") return Triangles(file, count, counts, first);
    if (kind == "texturecoords") {
      QUARRY_TRY(file.words.Word("an image's name"));
      file.scene.images_left_out = true;
    }
    for (uint32_t i = 0; i < count; ++i) {
      if (kind == "vertices" || kind == "normals") {
        QUARRY_ASSIGN(const glm::dvec3 v, file.Vec3("a vertex or normal"));
        QUARRY_TRY(kind == "vertices" ? AddPosition(file, v) : AddNormal(file, v));
      } else if (kind == "texturecoords") {
        QUARRY_ASSIGN(const double u, file.words.Number("a texture coordinate"));
        QUARRY_ASSIGN(const double v, file.words.Number("a texture coordinate"));
        ++file.scene.uvs;
        if (!file.scene.animations_only) QUARRY_TRY(file.scene.sink.AddUv(glm::vec2(u, v)));
      } else {
        return file.words.FailHere(fmt::format("{} in a mesh", Quoted(kind)));
      }
    }
    counts[kind == "vertices" ? 0 : kind == "normals" ? 1 : 2] = count;
  }
}

}  // namespace quarry

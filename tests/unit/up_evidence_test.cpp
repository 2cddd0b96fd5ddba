#include "preprocess/ingest/up_evidence.h"

#include <catch2/catch.hpp>
#include <utility>
#include <vector>

namespace quarry {
namespace {

struct Mesh {
  std::vector<KdTriangle> triangles;
  Box bounds{glm::vec3(1e30f), glm::vec3(-1e30f)};

  void Add(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
    triangles.push_back({{a, b, c}});
    for (const glm::vec3& p : {a, b, c}) bounds.Include(p);
  }
  void AddQuad(const glm::vec3& a, const glm::vec3& ab, const glm::vec3& ad) {
    Add(a, a + ab, a + ab + ad);
    Add(a, a + ab + ad, a + ad);
  }
  /// Exchanges y and z.
  Mesh Tipped() const {
    Mesh tipped;
    const auto tip = [](const glm::vec3& p) { return glm::vec3(p.x, p.z, p.y); };
    for (const KdTriangle& t : triangles)
      tipped.Add(tip(t.vertices[0]), tip(t.vertices[1]), tip(t.vertices[2]));
    return tipped;
  }
  double evidence() const { return UpEvidence(triangles); }
};

/// A house on a plot: z up.
Mesh House() {
  Mesh m;
  m.AddQuad({-20, -20, 0}, {40, 0, 0}, {0, 40, 0});
  m.AddQuad({-4, -4, 0}, {8, 0, 0}, {0, 0, 6});
  m.AddQuad({-4, 4, 0}, {8, 0, 0}, {0, 0, 6});
  m.AddQuad({-4, -4, 0}, {0, 8, 0}, {0, 0, 6});
  m.AddQuad({4, -4, 0}, {0, 8, 0}, {0, 0, 6});
  m.AddQuad({-4, -4, 6}, {8, 0, 0}, {0, 4, 3});
  m.AddQuad({-4, 4, 6}, {8, 0, 0}, {0, -4, 3});
  return m;
}

/// A room with a floor, a ceiling and four walls, lower than wide: z up.
Mesh Room() {
  Mesh m;
  m.AddQuad({0, 0, 0}, {8, 0, 0}, {0, 6, 0});
  m.AddQuad({0, 0, 3}, {0, 6, 0}, {8, 0, 0});
  m.AddQuad({0, 0, 0}, {0, 0, 3}, {8, 0, 0});
  m.AddQuad({0, 6, 0}, {8, 0, 0}, {0, 0, 3});
  m.AddQuad({0, 0, 0}, {0, 6, 0}, {0, 0, 3});
  m.AddQuad({8, 0, 0}, {0, 0, 3}, {0, 6, 0});
  return m;
}

}  // namespace

TEST_CASE("Floors, open ground and low scenes speak for the axis that is up", "[up]") {
  for (const Mesh& mesh : {House(), Room()}) {
    CHECK(mesh.evidence() < -0.2);
    CHECK(mesh.Tipped().evidence() == Approx(-mesh.evidence()));
  }
}

TEST_CASE("Nothing speaks where there is nothing", "[up]") {
  CHECK(Mesh().evidence() == 0);
  Mesh line;
  line.Add({0, 0, 0}, {1, 1, 1}, {2, 2, 2});
  CHECK(line.evidence() == 0);
}

}  // namespace quarry

#include "preprocess/ingest/up_evidence.h"

#include <catch2/catch.hpp>
#include <string>
#include <utility>
#include <vector>

#include "preprocess/import/text/up_hint.h"

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

void AddBox(Mesh& m, const glm::vec3& low, const glm::vec3& high) {
  const glm::vec3 s = high - low, x(s.x, 0, 0), y(0, s.y, 0), z(0, 0, s.z);
  m.AddQuad(low, x, y);
  m.AddQuad(low + z, x, y);
  m.AddQuad(low, x, z);
  m.AddQuad(low + y, x, z);
  m.AddQuad(low, y, z);
  m.AddQuad(low + x, y, z);
}

/// Storeys of slabs and two walls: z up.
Mesh Tower() {
  Mesh m;
  for (int k = 0; k < 12; ++k) {
    const float z = 3.5f * static_cast<float>(k);
    AddBox(m, {0, 0, z}, {18, 14, z + 0.3f});
    AddBox(m, {0, 0, z}, {18, 0.3f, z + 3.5f});
    AddBox(m, {0, 13.7f, z}, {18, 14, z + 3.5f});
  }
  return m;
}

/// Solid steps: z up.
Mesh Stairs() {
  Mesh m;
  for (int k = 0; k < 14; ++k) {
    const auto i = static_cast<float>(k);
    AddBox(m, {0, 0.28f * i, 0}, {1, 0.28f * (i + 1), 0.175f * (i + 1)});
  }
  return m;
}

}  // namespace

TEST_CASE("Floors, open ground and low scenes are evidence for the up axis", "[up]") {
  for (const Mesh& mesh : {House(), Room()}) {
    CHECK(mesh.evidence() < -0.2);
    CHECK(mesh.Tipped().evidence() == Approx(-mesh.evidence()));
  }
}

TEST_CASE("Doubled faces, windings, order, scale and strays do not change the evidence", "[up]") {
  for (const Mesh& mesh : {House(), Room(), Tower(), Stairs()}) {
    const double evidence = mesh.evidence();
    CHECK(evidence < -0.12);
    Mesh doubled = mesh, reversed, turned, large, stray = mesh;
    for (const KdTriangle& t : mesh.triangles) {
      const auto& [a, b, c] = t.vertices;
      doubled.Add(a, c, b);
      reversed.Add(c, b, a);
      large.Add(a * 1000.0f, b * 1000.0f, c * 1000.0f);
    }
    turned.triangles.assign(mesh.triangles.rbegin(), mesh.triangles.rend());
    stray.Add({900, 900, 900}, {900.1f, 900, 900}, {900, 900.1f, 900});
    CHECK(doubled.evidence() == Approx(evidence).margin(0.05));
    CHECK(reversed.evidence() == Approx(evidence));
    CHECK(turned.evidence() == Approx(evidence));
    CHECK(large.evidence() == Approx(evidence).margin(0.01));
    if (mesh.triangles.size() >= 16) CHECK(stray.evidence() == Approx(evidence).margin(0.2));
  }
}

TEST_CASE("Comments are evidence for the up axis: by words, or by the program that wrote them", "[up]") {
  const auto hint = [](const char* extension, const char* head) {
    const UpHint h = UpHintOf(extension, head);
    return h.axis == 0 ? std::string("none") : std::string(h.axis == 1 ? "y" : "z") + (h.stated ? "!" : "");
  };
  CHECK(hint(".obj", "# Blender 3.6.0\n# www.blender.org\nmtllib a.mtl\n") == "y");
  CHECK(hint(".STL", "Exported from Blender-3.4.1\0\0") == "z");
  CHECK(hint(".ply", "ply\nformat ascii 1.0\ncomment Created in Blender version 4.0\nend_header\n") == "z");
  CHECK(hint(".obj", "# made by hand\n# Z-up, metres\nv 0 0 0\n") == "z!");
  CHECK(hint(".obj", "v 0 0 0\n# Up axis: Y\n") == "y!");
  CHECK(hint(".obj", "# Z_UP = true\r\n") == "z!");
  CHECK(hint(".obj", "# z-up turned to y-up\n") == "none");
  CHECK(hint(".obj", "# 3ds Max Wavefront OBJ Exporter v0.97b\n") == "y");
  CHECK(hint(".obj", "o blender\nv 0 0 0\n") == "none");
  CHECK(hint(".obj", "# a mayan temple, sup y\n") == "none");
  CHECK(hint(".stl", "solid OpenSCAD_Model\nfacet normal 0 0 1\n") == "z");
  CHECK(hint(".ply", "ply\nend_header\ncomment z-up\n") == "none");
  CHECK(hint(".obj", "") == "none");
}

TEST_CASE("An empty model gives no evidence", "[up]") {
  CHECK(Mesh().evidence() == 0);
  Mesh line;
  line.Add({0, 0, 0}, {1, 1, 1}, {2, 2, 2});
  CHECK(line.evidence() == 0);
}

}  // namespace quarry

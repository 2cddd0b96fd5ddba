#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>

#include "tests/support/skip.h"
#include "tests/unit/recording_sink.h"

namespace quarry {
namespace {

constexpr const char* kHead =
    "b 0 0 1\nv\nfrom 1 2 3\nat 0 0 0\nup 0 0 1\nangle 45\nhither 1\nresolution 5 5\nl 1 2 3\n";

RecordingSink Import(const std::string& name, const std::string& text) {
  RecordingSink sink;
  CHECK(ImportText(name, text, sink) == "");
  return sink;
}

}  // namespace

TEST_CASE("NFF: the view is a camera, and lights have their brightness at the point it looks at") {
  const RecordingSink s =
      Import("a.nff", std::string(kHead) + "l lamp 0 0 2 1 0.5 0.25\np 3\n0 0 0\n1 0 0\n1 1 0\n");
  REQUIRE(s.cameras.size() == 1);
  CHECK(s.cameras[0].name == "view 1");
  CHECK(s.cameras[0].spec.eye == glm::dvec3(1, 2, 3));
  CHECK(s.cameras[0].spec.fov_degrees == 45);
  REQUIRE(s.lights.size() == 2);
  CHECK(s.lights[0].position == glm::dvec3(1, 2, 3));
  CHECK(s.lights[0].radiance.x == Approx(14 / std::sqrt(2.0)));
  CHECK(s.lights[1].name == "lamp");
  CHECK(s.lights[1].radiance == glm::vec3(4, 2, 1));
}

TEST_CASE("NFF: polygons, patches and fills") {
  const RecordingSink s = Import("a.nff", std::string(kHead) +
                                              "f 1 0.5 0.25 0.8 0.5 12 0 1 # a comment\n"
                                              "p 4\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n"
                                              "f 1 1 1 0.1 0 0 0.9 1.5\n"
                                              "pp 3\n0 0 1 0 0 2\n1 0 1 0 0 2\n0 1 1 0 0 2\n"
                                              "f 1 0.5 0.25 0.8 0.5 12 0 1\np 3 0 0 2 1 0 2 0 1 2\n");
  CHECK(s.triangles == 4);
  REQUIRE(s.materials.size() == 2);
  CHECK(s.materials[0].diffuse == glm::vec3(0.8f, 0.4f, 0.2f));
  CHECK(s.materials[0].specular == glm::vec3(0.5f, 0.25f, 0.125f));
  CHECK(s.materials[0].shininess == 12);
  CHECK(s.materials[1].transmittance == glm::vec3(0.9f));
  CHECK(s.materials[1].ior == 1.5f);
  REQUIRE(s.polygons.size() == 3);
  CHECK(s.polygons[0].corners.size() == 4);
  CHECK(s.polygons[0].corners[0].normal == kNoIndex);
  CHECK(s.polygons[1].corners[2].normal == 2);
  CHECK(s.polygons[2].material == s.polygons[0].material);
  CHECK(s.normals[0] == glm::vec3(0, 0, 1));
}

TEST_CASE("NFF: spheres and cones become triangles with normals that point out") {
  const RecordingSink s = Import("a.nff", std::string(kHead) + "s 1 2 3 0.5\n");
  CHECK(s.triangles == 24 * 11 * 2);
  for (size_t i = 0; i < s.positions.size(); ++i) {
    CHECK(glm::length(s.positions[i] - glm::dvec3(1, 2, 3)) == Approx(0.5));
    CHECK(glm::dot(s.positions[i] - glm::dvec3(1, 2, 3), glm::dvec3(s.normals[i])) == Approx(0.5));
  }
  double area = 0;
  for (const auto& p : s.polygons)
    for (size_t k = 2; k < p.corners.size(); ++k) {
      const glm::dvec3 a = s.positions[p.corners[0].position];
      const glm::dvec3 n =
          glm::cross(s.positions[p.corners[k - 1].position] - a, s.positions[p.corners[k].position] - a);
      area += glm::length(n) / 2;
      CHECK(std::fabs(glm::dot(glm::normalize(n), glm::dvec3(s.normals[p.corners[0].normal]))) > 0.9);
    }
  CHECK(area == Approx(3.14159265).epsilon(0.03));

  const RecordingSink c = Import("c.nff", std::string(kHead) + "c\n0 0 0 2\n0 0 4 1\n");
  CHECK(c.triangles == 48);
  for (size_t i = 0; i < c.positions.size(); ++i) {
    const glm::dvec3 p = c.positions[i];
    CHECK(std::hypot(p.x, p.y) == Approx(2 - p.z / 4));
    CHECK(glm::dot(glm::dvec3(c.normals[i]), glm::dvec3(p.x, p.y, 0)) > 0);
    CHECK(c.normals[i].z == Approx(1 / std::sqrt(17.0)));
  }
}

TEST_CASE("AFF: included files, transforms, animations at their first moment") {
  const TemporaryFolder folder;
  folder.Write("leaf.aff",
               "% one triangle\nfm 0 0 0  0.5 0.5 0.5  0.1 0.1 0.1  9 0 0\nm\nvertices 3\n1 0 0  0 1 0  0 0 "
               "1\nnormals 1\n1 0 0\n"
               "texturecoords 3 leaf.ppm 0 0 1 0 0 1\ntriangles 1\n0 1 2  0 0 0  0 1 2\n");
  // Scaled by two, then turned about z by 90 degrees, then moved.
  const std::string path = folder.Write("top.aff",
                                        "b 1 1 1\nam 1 1 1\na 10 20 5\nxs 2 2 2  0 0 1 90  0 0 5\n{\n i 0 "
                                        "leaf.aff\n}\nx car\n{\n i 0 leaf.aff\n}\n"
                                        "k car\n{\n transl 2\n 0  0 0 0  0 0 0\n 20  4 0 0  0 0 0\n rot 1\n "
                                        "0  0 0 1 180  0 0 0\n visibility 1\n 0 1\n}\n");
  RecordingSink s;
  REQUIRE(ImportModel(path, s));
  CHECK(s.triangles == 2);
  CHECK(s.materials.size() == 1);
  CHECK(s.parts == std::vector<std::string>{"leaf"});
  const glm::dvec3 expected[] = {{0, 2, 5}, {-2, 0, 5}, {0, 0, 7}, {1, 0, 0}, {2, -1, 0}, {2, 0, 1}};
  for (size_t i = 0; i < 6; ++i) CHECK(glm::length(s.positions[i] - expected[i]) < 1e-12);
  CHECK(glm::length(s.normals[0] - glm::vec3(0, 1, 0)) < 1e-6f);
  CHECK(s.polygons[0].corners[2].uv == 2);
  CHECK(s.warnings.size() == 1);
}

TEST_CASE("NFF: too many spheres and cones are refused with figures") {
  std::string text = kHead;
  for (int i = 0; i < 94697; ++i) text += "s 0 0 0 1\n";
  CHECK(ErrorOf("a.nff", text) ==
        "a.nff, line 94706: its first 94697 spheres and cones become 50000016 triangles (528 a sphere, 48 a "
        "cone), and at most 50000000 are made; give a model with fewer, or with meshes instead");
}

TEST_CASE("Broken NFF and AFF files are refused with the place") {
  const std::string head = "b 0 0 1\n";
  CHECK(ErrorOf("a.nff", head + "p 3\n0 0 0\n1 0 x\n") ==
        "a.nff, line 4: a corner should be here, a number, not \"x\"");
  CHECK(ErrorOf("a.nff", head + "p 3\n0 0 0\n1 0") ==
        "a.nff, line 5: the file ends where a corner should be");
  CHECK(ErrorOf("a.nff", head + "p 99999999\n").find("the number of corners should be here, from 0 to") !=
        std::string::npos);
  CHECK(ErrorOf("a.nff", head + "q 1\n") ==
        "a.nff, line 2: \"q\" is not an entity of NFF or AFF that is read");
  CHECK(ErrorOf("a.aff", head + "xs 1 1 1 0 0 1 0 0 0 0 {\n").find("the file ends before a '}'") !=
        std::string::npos);
  CHECK(ErrorOf("a.aff", head + "}\n").find("a '}' without its '{'") != std::string::npos);
  CHECK(ErrorOf("a.aff", head + "m vertices 3 0 0 0 1 0 0 0 1 0 triangles 1 0 1 3\n")
            .find("an index should be here") != std::string::npos);
  CHECK(ErrorOf("a.aff", head + "i 0 none.aff\n").find("none.aff") != std::string::npos);
  // A file that includes itself.
  CHECK(ErrorOf("self.aff", head + "i 0 self.aff\n").find("nested included files are too many") !=
        std::string::npos);
  CHECK(ErrorOf("a.nff", head) == "a.nff: holds no triangles");
}

TEST_CASE("BART's kitchen and robots, and their conversions to OBJ, are the same scenes") {
  const std::filesystem::path bart = std::filesystem::path(QUARRY_SCENES_DIR) / "bart";
  if (!std::filesystem::exists(bart)) {
    test::Skip(bart.string() + " is not there");
    return;
  }
  const auto same = [&](const char* aff, const char* obj, uint64_t triangles) {
    RecordingSink a, b;
    REQUIRE(ImportModel((bart / aff).string(), a));
    REQUIRE(ImportModel((bart / obj).string(), b));
    CHECK(a.triangles == triangles);
    CHECK(b.triangles == triangles);
    const auto sum = [](const RecordingSink& s) {
      glm::dvec3 total(0);
      for (const auto& p : s.polygons)
        for (const Corner& c : p.corners) total += glm::abs(s.positions[c.position]);
      return total;
    };
    for (int axis = 0; axis < 3; ++axis) CHECK(sum(a)[axis] == Approx(sum(b)[axis]).epsilon(1e-4));
  };
  same("scene_kitchen/aff/kitchen.aff", "scene_kitchen/kitchen.obj", 110561);
  same("scene_robot/aff/Robot.aff", "scene_robot/robot.obj", 71708);
}

}  // namespace quarry

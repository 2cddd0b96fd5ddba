#include "common/engine/framing_probe.h"

#include <fmt/format.h>

#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <fstream>
#include <glm/geometric.hpp>
#include <string>

#include "tests/support/models/made_store.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

/// Text of an OBJ file, built face by face.
class Model {
 public:
  void AddQuad(const glm::dvec3& a, const glm::dvec3& b, const glm::dvec3& c, const glm::dvec3& d) {
    for (const glm::dvec3& p : {a, b, c, d}) text_ += fmt::format("v {} {} {}\n", p.x, p.y, p.z);
    text_ += "f -4 -3 -2 -1\n";
  }
  /// A sphere of 2 * n * n quads, facing outwards.
  void AddSphere(const glm::dvec3& middle, double radius, int n) {
    const auto at = [&](int i, int j) {
      const double u = M_PI * i / n, v = M_PI * j / n;
      return middle + radius * glm::dvec3(std::sin(u) * std::cos(v), std::sin(u) * std::sin(v), std::cos(u));
    };
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < 2 * n; ++j) AddQuad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
  }
  /// The inside of a box, each wall of 16 x 16 quads; without its front (least y) if `open`.
  void AddRoom(const glm::dvec3& size, bool open) {
    const auto wall = [&](const glm::dvec3& a, const glm::dvec3& u, const glm::dvec3& v) {
      for (int i = 0; i < 16; ++i)
        for (int j = 0; j < 16; ++j) {
          const glm::dvec3 p = a + u * (i / 16.0) + v * (j / 16.0), du = u / 16.0, dv = v / 16.0;
          AddQuad(p, p + du, p + du + dv, p + dv);
        }
    };
    const glm::dvec3 x(size.x, 0, 0), y(0, size.y, 0), z(0, 0, size.z), o(0);
    wall(o, x, y);
    wall(z, y, x);
    wall(y, x, z);
    if (!open) wall(o, z, x);
    wall(o, y, z);
    wall(x, z, y);
  }
  void AddBox(const glm::dvec3& low, const glm::dvec3& high) {
    const auto at = [&](int corner) {
      return glm::dvec3(corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y,
                        corner & 4 ? high.z : low.z);
    };
    for (const auto& [a, b, c, d] : {std::array{0, 2, 3, 1}, std::array{4, 5, 7, 6}, std::array{0, 1, 5, 4},
                                     std::array{2, 6, 7, 3}, std::array{0, 4, 6, 2}, std::array{1, 3, 7, 5}})
      AddQuad(at(a), at(b), at(c), at(d));
  }
  /// Storeys of slabs and columns.
  void AddTower(int storeys) {
    for (int k = 0; k <= storeys; ++k) AddBox({0, 0, 3.5 * k - 0.3}, {18, 14, 3.5 * k});
    for (int k = 0; k < storeys; ++k)
      for (int i = 0; i < 7; ++i)
        for (int j = 0; j < 5; ++j)
          if (i % 6 == 0 || j % 4 == 0)
            AddBox({2.9 * i, 3.3 * j, 3.5 * k}, {2.9 * i + 0.4, 3.3 * j + 0.4, 3.5 * k + 3.2});
  }
  /// Appends another model's faces; the other way round if `reversed`.
  void Add(const Model& other, bool reversed) {
    text_ += other.text_;
    if (!reversed) return;
    size_t at = 0;
    while ((at = text_.find("f -4 -3 -2 -1", at)) != std::string::npos)
      text_.replace(at, 13, "f -1 -2 -3 -4");
  }
  Framing Probe(bool find_inside) const {
    const TemporaryFolder folder;
    std::ofstream(folder.file("m.obj")) << text_;
    MakeStore({.models = {folder.file("m.obj")}, .output = folder.file("m.quarry"), .up_axis = 2});
    const auto scene = Scene::Open(folder.file("m.quarry"));
    REQUIRE(scene.has_value());
    const auto framing = ProbeFraming(*scene, 0, find_inside);
    REQUIRE(framing.has_value());
    return *framing;
  }

 private:
  std::string text_;
};

bool IsWithin(const glm::dvec3& p, const glm::dvec3& lower, const glm::dvec3& upper) {
  return p.x > lower.x && p.x < upper.x && p.y > lower.y && p.y < upper.y && p.z > lower.z && p.z < upper.z;
}

}  // namespace

TEST_CASE("Far strays and base plates are not framed", "[framing]") {
  for (const int n : {24, 160}) {  // by triangles, and by voxels
    Model model;
    model.AddSphere({0, 0, 1}, 1, n);
    model.AddQuad({900, 900, 900}, {901, 900, 900}, {901, 901, 900}, {900, 901, 900});
    model.AddQuad({-300, -300, 0}, {300, -300, 0}, {300, 300, 0}, {-300, 300, 0});
    const Framing framing = model.Probe(false);
    INFO(n << " " << framing.upper.x << " " << framing.upper.y << " " << framing.upper.z);
    CHECK(glm::length(framing.lower - glm::dvec3(-1, -1, 0)) < 0.2);
    CHECK(glm::length(framing.upper - glm::dvec3(1, 1, 2)) < 0.2);
    CHECK_FALSE(framing.interior);
    CHECK(framing.hull.size() > 100);
    const CameraSpec camera = CameraFor(framing, NamedView::kIso, {});
    CHECK(glm::length(camera.eye - glm::dvec3(0, 0, 1)) < 5);
  }
}

TEST_CASE("All of a model without strays is framed", "[framing]") {
  Model model;
  model.AddSphere({0, 0, 0}, 1, 32);
  model.AddQuad({1, 0, 0}, {1.5, 0, 0}, {1.5, 0.1, 0}, {1, 0.1, 0});  // a spout
  const Framing framing = model.Probe(false);
  CHECK(framing.upper.x == Approx(1.5));
  CHECK(framing.lower.z == Approx(-1));
}

TEST_CASE(
    "An object on a plate is framed, whatever voxels the plate crosses, and so is one before a backdrop",
    "[framing]") {
  for (const bool backdrop : {false, true}) {
    Model model;
    model.AddSphere({0, 0, 1}, 1, 250);
    model.AddQuad({-20, -20, 0}, {20, -20, 0}, {20, 20, 0}, {-20, 20, 0});
    if (backdrop) model.AddQuad({-20, 1.5, 0}, {20, 1.5, 0}, {20, 1.5, 20}, {-20, 1.5, 20});
    const Framing framing = model.Probe(false);
    CHECK_FALSE(framing.interior);
    CHECK(glm::length(framing.lower - glm::dvec3(-1, -1, 0)) < 0.1);
    CHECK(glm::length(framing.upper - glm::dvec3(1, backdrop ? 1.5 : 1, 2)) < 0.6);
  }
}

TEST_CASE("A solid, or a tower of storeys, is no interior, whichever way its faces turn", "[framing]") {
  for (const bool reversed : {false, true}) {
    Model solid, tower, room, things;
    things.AddSphere({0, 0, 0}, 1, 32);
    solid.Add(things, reversed);
    CHECK_FALSE(solid.Probe(false).interior);
    Model storeys;
    storeys.AddTower(12);
    tower.Add(storeys, reversed);
    CHECK_FALSE(tower.Probe(false).interior);
    Model hall;
    hall.AddRoom({8, 6, 3}, false);
    hall.AddSphere({4, 3, 0.5}, 0.5, 12);
    room.Add(hall, reversed);
    CHECK(room.Probe(false).interior);
  }
}

TEST_CASE("A solid case whose pins reach into it is no interior", "[framing]") {
  Model relay;
  relay.AddBox({0, 0, 0}, {29, 12, 15});
  for (const double x : {3.0, 9.0, 20.0, 26.0})
    for (const double y : {2.0, 9.0}) relay.AddBox({x, y, -0.5}, {x + 0.5, y + 1, 6});
  CHECK_FALSE(relay.Probe(false).interior);
}

TEST_CASE("The view inside has no column in its middle", "[framing]") {
  Model model;
  model.AddRoom({16, 12, 3}, false);
  model.AddSphere({8, 6, 0.5}, 0.5, 12);
  for (const glm::dvec3 place :
       {glm::dvec3(5, 4, 0), glm::dvec3(11, 4, 0), glm::dvec3(5, 8, 0), glm::dvec3(11, 8, 0)})
    model.AddBox(place - glm::dvec3(0.3, 0.3, 0), place + glm::dvec3(0.3, 0.3, 3));
  const Framing framing = model.Probe(true);
  REQUIRE(framing.inside.has_value());
  const glm::dvec3 forward = glm::normalize(framing.inside->at - framing.inside->eye);
  for (double along = 0.1; along < 6; along += 0.1) {
    const glm::dvec3 p = framing.inside->eye + along * forward;
    for (const double x : {5.0, 11.0})
      for (const double y : {4.0, 8.0}) CHECK_FALSE((std::fabs(p.x - x) < 0.3 && std::fabs(p.y - y) < 0.3));
  }
}

TEST_CASE("A closed room is an interior, seen from a place inside", "[framing]") {
  Model model;
  model.AddRoom({8, 6, 3}, false);
  model.AddSphere({4, 3, 0.5}, 0.5, 12);
  const Framing framing = model.Probe(false);
  CHECK(framing.interior);
  REQUIRE(framing.inside.has_value());
  CHECK(IsWithin(framing.inside->eye, {0, 0, 0}, {8, 6, 3}));
  CHECK(framing.inside_distance > 0.5);
  CHECK(framing.inside_distance < 10);
}

TEST_CASE("A room without a side is seen through it", "[framing]") {
  Model model;
  model.AddRoom({4, 4, 4}, true);
  const Framing framing = model.Probe(false);
  CHECK(framing.interior);
  REQUIRE(framing.inside.has_value());
  CHECK(framing.inside->eye.y < 0);
  CHECK(framing.inside->eye.x == Approx(2).margin(0.2));
  CHECK(glm::dot(framing.inside->at - framing.inside->eye, glm::dvec3(0, 1, 0)) > 0);
}

TEST_CASE("A solid is no interior, but has a place inside when one is asked for", "[framing]") {
  Model model;
  model.AddSphere({0, 0, 0}, 1, 32);
  CHECK_FALSE(model.Probe(false).interior);
  CHECK_FALSE(model.Probe(false).inside.has_value());
  const Framing framing = model.Probe(true);
  CHECK_FALSE(framing.interior);
  REQUIRE(framing.inside.has_value());
  CHECK(CheckCamera(*framing.inside).has_value());
}

}  // namespace quarry::test

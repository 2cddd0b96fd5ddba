#include "preprocess/ingest/part_sums.h"

#include <algorithm>
#include <array>
#include <catch2/catch.hpp>
#include <cmath>
#include <limits>
#include <random>

namespace quarry {
namespace {

using Triangle = std::array<glm::vec3, 3>;

/// A cube of side 1 at a corner, of two triangles a side, counter-clockwise seen from outside.
std::vector<Triangle> Cube(const glm::vec3& corner) {
  constexpr int kSides[6][4] = {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}};
  std::vector<Triangle> triangles;
  for (const auto& side : kSides) {
    const auto at = [&](int k) {
      return corner + glm::vec3(static_cast<float>(side[k] & 1), static_cast<float>(side[k] >> 1 & 1),
                                static_cast<float>(side[k] >> 2));
    };
    triangles.push_back({at(0), at(1), at(2)});
    triangles.push_back({at(0), at(2), at(3)});
  }
  return triangles;
}

void Invert(std::vector<Triangle>& triangles) {
  for (Triangle& t : triangles) std::swap(t[1], t[2]);
}

/// Adds the triangles in runs of 1, 2, 3, ... triangles.
void Add(PartSums& sums, uint32_t part, const std::vector<Triangle>& triangles) {
  std::vector<PartRun> runs;
  size_t room = 1;
  for (const Triangle& t : triangles) {
    TriangleRecord record;
    std::ranges::copy(t, record.vertices);
    record.part = part;
    AddToRuns(record, FaultOf(record), runs);
    CHECK(runs.size() == 1);
    if (runs.front().sum.triangles < room) continue;
    sums.Add(runs.front());
    runs.clear();
    ++room;
  }
  for (const PartRun& run : runs) sums.Add(run);
}

ScenePart FactsOf(const std::vector<Triangle>& triangles) {
  PartSums sums;
  Add(sums, 1, triangles);
  std::vector<ScenePart> parts(3);
  sums.GiveTo(parts);
  CHECK((parts[0] == ScenePart{} && parts[2] == ScenePart{}));
  return parts[1];
}

constexpr uint32_t kClosed = ScenePart::kClosed, kInverted = ScenePart::kClosed | ScenePart::kInsideOut;

}  // namespace

TEST_CASE("A part's triangles give its box and whether it is closed", "[parts]") {
  std::vector<Triangle> cube = Cube({1000, 2000, -3000});
  ScenePart facts = FactsOf(cube);
  CHECK(facts.flags == kClosed);
  CHECK(facts.triangles == 12);
  CHECK((facts.lower == glm::vec3(1000, 2000, -3000) && facts.upper == glm::vec3(1001, 2001, -2999)));
  Invert(cube);
  CHECK(FactsOf(cube).flags == kInverted);
  Invert(cube);
  SECTION("one triangle is missing") {
    cube.pop_back();
    CHECK(FactsOf(cube).flags == 0);
  }
  SECTION("one triangle is turned") {
    std::swap(cube[3][0], cube[3][1]);
    CHECK(FactsOf(cube).flags == 0);
  }
  SECTION("one triangle comes twice") {
    cube.push_back(cube[0]);
    CHECK(FactsOf(cube).flags == 0);
  }
  SECTION("two bodies, one of them turned") {
    std::vector<Triangle> small = Cube({0, 0, 0});
    Invert(small);
    cube.insert(cube.end(), small.begin(), small.end());
    for (size_t i = 0; i < 12; ++i)
      for (glm::vec3& corner : cube[i]) corner *= 2.0f;
    CHECK(FactsOf(cube).flags == kClosed);
  }
  SECTION("a triangle without area closes a gap between edges of two lengths") {
    // The edge of one triangle is two edges of its neighbours; the sliver between them has no area.
    const glm::vec3 a = cube[0][0], b = cube[0][1], c = cube[0][2], middle = (a + b) * 0.5f;
    cube[0] = {a, middle, c};
    cube.push_back({middle, b, c});
    CHECK(FactsOf(cube).flags == 0);
    cube.push_back({a, b, middle});
    CHECK(FactsOf(cube).flags == kClosed);
  }
  SECTION("zeros of both signs are one position") {
    std::vector<Triangle> at_zero = Cube({0, 0, 0});
    for (size_t i = 0; i < at_zero.size(); i += 2)
      for (glm::vec3& corner : at_zero[i])
        if (corner.x == 0) corner.x = -0.0f;
    CHECK(FactsOf(at_zero).flags == kClosed);
  }
  SECTION("far away and small") {
    std::vector<Triangle> far = Cube({0, 0, 0});
    for (Triangle& t : far)
      for (glm::vec3& corner : t) corner = corner * 0.002f + glm::vec3(16000, -16000, 16000);
    CHECK(FactsOf(far).flags == kClosed);
    Invert(far);
    CHECK(FactsOf(far).flags == kInverted);
  }
  SECTION("a corner that is not finite leaves the box alone") {
    cube[5][1].y = std::numeric_limits<float>::quiet_NaN();
    facts = FactsOf(cube);
    CHECK(facts.triangles == 12);
    CHECK(facts.flags == 0);
    CHECK(facts.upper == glm::vec3(1001, 2001, -2999));
  }
}

TEST_CASE("A part of triangles without area has no box", "[parts]") {
  const ScenePart facts = FactsOf({{glm::vec3(1), glm::vec3(2), glm::vec3(3)}});
  CHECK(facts.triangles == 1);
  CHECK((facts.lower == ScenePart{}.lower && facts.upper == ScenePart{}.upper));
  CHECK(facts.flags == 0);
}

TEST_CASE("No sum of edges is zero by chance", "[parts]") {
  // Open pieces of regular grids, whose positions differ in few bits.
  std::mt19937 random(9);
  for (int round = 0; round < 2000; ++round) {
    std::vector<Triangle> grid;
    const int width = 1 + static_cast<int>(random() % 8), height = 1 + static_cast<int>(random() % 8);
    const float step = std::ldexp(1.0f, static_cast<int>(random() % 8) - 4);
    for (int x = 0; x < width; ++x)
      for (int y = 0; y < height; ++y) {
        const auto at = [&](int i, int k) {
          return glm::vec3(static_cast<float>(x + i), static_cast<float>(y + k), 0) * step;
        };
        grid.push_back({at(0, 0), at(1, 0), at(1, 1)});
        grid.push_back({at(0, 0), at(1, 1), at(0, 1)});
      }
    REQUIRE(FactsOf(grid).flags == 0);
  }
}

TEST_CASE("Sums of parts outlive a process", "[parts]") {
  PartSums sums;
  Add(sums, 0, Cube({1, 2, 3}));
  const std::vector<Triangle> other = Cube({5, 6, 7});
  Add(sums, 2, {other.begin(), other.begin() + 5});
  ByteWriter out;
  sums.Save(out);
  PartSums restored;
  const Bytes saved = out.Take();
  ByteReader in(saved);
  restored.Restore(in);
  CHECK(in.done());
  for (PartSums* s : {&sums, &restored}) Add(*s, 2, {other.begin() + 5, other.end()});
  std::vector<ScenePart> expected(3), got(3);
  sums.GiveTo(expected);
  restored.GiveTo(got);
  CHECK(got == expected);
  CHECK(got[2].flags == kClosed);
}

}  // namespace quarry

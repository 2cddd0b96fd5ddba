#include "preprocess/import/polygon/triangulation.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <map>
#include <numbers>
#include <random>

#include "preprocess/import/polygon/orientation.h"

namespace quarry {
namespace {

using Polygon = std::vector<glm::vec2>;

std::vector<glm::vec3> InSpace(const Polygon& polygon) {
  std::vector<glm::vec3> corners;
  for (const glm::vec2& p : polygon) corners.emplace_back(p.x, p.y, 0);
  return corners;
}

double Twice(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c) {
  return (double{a.x} - c.x) * (double{b.y} - c.y) - (double{a.y} - c.y) * (double{b.x} - c.x);
}

double AreaOf(const Polygon& p) {
  double twice = 0;
  for (size_t i = 2; i < p.size(); ++i) twice += Twice(p[0], p[i - 1], p[i]);
  return twice / 2;
}

std::vector<Triangulator::Triangle> TrianglesOf(const Polygon& polygon) {
  Triangulator triangulator;
  const auto split = triangulator.Split(InSpace(polygon));
  std::vector<Triangulator::Triangle> triangles(split.begin(), split.end());
  if (triangles.empty())
    for (uint32_t i = 2; i < polygon.size(); ++i) triangles.push_back({0, i - 1, i});
  return triangles;
}

/// Each edge of the polygon once, in its direction; all others twice, once in each: no gap, no corner left
/// out.
bool IsWhole(const Polygon& polygon, const std::vector<Triangulator::Triangle>& triangles) {
  const auto n = static_cast<uint32_t>(polygon.size());
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (uint32_t i = 0; i < n; ++i) --edges[{i, (i + 1) % n}];
  for (const auto& t : triangles)
    for (const auto& [from, to] : {std::pair(t.a, t.b), {t.b, t.c}, {t.c, t.a}}) {
      ++edges[{from, to}];
      --edges[{to, from}];
    }
  for (uint32_t i = 0; i < n; ++i) ++edges[{(i + 1) % n, i}];
  return std::ranges::all_of(edges, [](const auto& e) { return e.second == 0; });
}

/// Checks that the triangles are as many as the corners less two, that none is turned over, and that their
/// area is the polygon's. Triangles that are not turned over and fit edge to edge then do not overlap.
void CheckCovers(const Polygon& polygon) {
  const auto triangles = TrianglesOf(polygon);
  REQUIRE(triangles.size() == polygon.size() - 2);
  CHECK(IsWhole(polygon, triangles));
  const double area = AreaOf(polygon);
  double sum = 0;
  int turned = 0;
  for (const auto& t : triangles) {
    const double part = Twice(polygon[t.a], polygon[t.b], polygon[t.c]) / 2;
    turned += (part < 0) != (area < 0) && part != 0;
    sum += std::fabs(part);
  }
  CHECK(turned == 0);
  CHECK(sum == Approx(std::fabs(area)).epsilon(1e-6));
}

/// Round a centre, by angles that grow: simple, and rarely convex.
Polygon RandomStar(std::mt19937& chance, uint32_t corners, float least) {
  std::uniform_real_distribution<float> radius(least, 1);
  Polygon polygon;
  for (uint32_t i = 0; i < corners; ++i) {
    const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(i) / static_cast<float>(corners),
                r = radius(chance);
    polygon.emplace_back(r * std::cos(angle), r * std::sin(angle));
  }
  return polygon;
}

bool Cross(const glm::vec2& a, const glm::vec2& b, const glm::vec2& c, const glm::vec2& d) {
  return Orientation(a, b, c) * Orientation(a, b, d) <= 0 && Orientation(c, d, a) * Orientation(c, d, b) <= 0;
}

/// Random points, joined and then untangled: any simple polygon may come of it.
Polygon RandomSimple(std::mt19937& chance, uint32_t corners, int places) {
  std::uniform_int_distribution<int> place(0, places);
  Polygon polygon;
  while (polygon.size() < corners) {
    const glm::vec2 p(place(chance), place(chance));
    if (std::ranges::find(polygon, p) == polygon.end()) polygon.push_back(p);
  }
  const size_t n = polygon.size();
  for (int rounds = 0; rounds < 2000; ++rounds) {
    bool crossed = false;
    for (size_t i = 0; i < n && !crossed; ++i)
      for (size_t k = i + 2; k < n && !crossed; ++k) {
        if (i == 0 && k == n - 1) continue;
        if (!Cross(polygon[i], polygon[i + 1], polygon[k], polygon[(k + 1) % n])) continue;
        std::reverse(polygon.begin() + static_cast<long>(i) + 1, polygon.begin() + static_cast<long>(k) + 1);
        crossed = true;
      }
    if (!crossed) return polygon;
  }
  return {};
}

/// A square with square holes in rows, each joined to the one below by an edge that is passed twice.
Polygon Keyholes(int columns, int rows) {
  Polygon polygon;
  polygon.emplace_back(0, 0);
  for (int x = 0; x < columns; ++x) {
    const auto left = static_cast<float>(4 * x + 1);
    polygon.emplace_back(left, 0);
    for (int y = 0; y < rows; ++y) {
      const auto low = static_cast<float>(4 * y + 1);
      polygon.emplace_back(left, low);
      polygon.emplace_back(left, low + 2);
    }
    for (int y = rows; y-- > 0;) {
      const auto low = static_cast<float>(4 * y + 1);
      polygon.emplace_back(left, low + 2);
      polygon.emplace_back(left + 2, low + 2);
      polygon.emplace_back(left + 2, low);
      polygon.emplace_back(left, low);
    }
    polygon.emplace_back(left, 0);
  }
  polygon.emplace_back(4 * columns, 0);
  polygon.emplace_back(4 * columns, 4 * rows);
  polygon.emplace_back(0, 4 * rows);
  return polygon;
}

Polygon Reversed(Polygon polygon) {
  std::ranges::reverse(polygon);
  return polygon;
}

}  // namespace

TEST_CASE("Orientation is exact", "[triangulation]") {
  const float big = 16777216;
  CHECK(Orientation({0, 0}, {1, 1}, {2, 2}) == 0);
  CHECK(Orientation({0, 0}, {big, big}, {1e-30f, 2e-30f}) == 1);
  CHECK(Orientation({0, 0}, {big, big}, {2e-30f, 1e-30f}) == -1);
  CHECK(Orientation({1e-30f, 1e-30f}, {1e30f, 1e30f}, {1, std::nextafter(1.0f, 2.0f)}) == 1);
  CHECK(Orientation({0.1f, 0.1f}, {0.2f, 0.2f}, {0.3f, 0.3f}) == 0);
  std::mt19937 chance(1);
  std::uniform_int_distribution<int64_t> cell(-1000, 1000);
  for (int i = 0; i < 100000; ++i) {
    int64_t v[6];
    for (int64_t& c : v) c = cell(chance);
    const int64_t turn = (v[0] - v[4]) * (v[3] - v[5]) - (v[1] - v[5]) * (v[2] - v[4]);
    const glm::vec2 a(v[0], v[1]), b(v[2], v[3]), c(v[4], v[5]);
    REQUIRE(Orientation(a, b, c) == (turn > 0) - (turn < 0));
    REQUIRE(ExactOrientation(a, b, c) == (turn > 0) - (turn < 0));
  }
}

TEST_CASE("Convex polygons stay fans", "[triangulation]") {
  Triangulator triangulator;
  for (const int corners : {4, 5, 17, 1000}) {
    Polygon polygon;
    for (int i = 0; i < corners; ++i) {
      const double angle = 2 * std::numbers::pi * i / corners;
      polygon.emplace_back(std::cos(angle), std::sin(angle));
    }
    CHECK(triangulator.Split(InSpace(polygon)).empty());
    CHECK(triangulator.Split(InSpace(Reversed(polygon))).empty());
  }
  // Corners on straight edges, and twice at one place.
  CHECK(triangulator.Split(InSpace({{0, 0}, {1, 0}, {2, 0}, {2, 2}, {2, 2}, {1, 2}, {0, 2}, {0, 1}, {0, 0}}))
            .empty());
  // A saddle has no better side.
  CHECK(triangulator.Split(std::vector<glm::vec3>{{0, 0, 0}, {1, 0, 1}, {1, 1, 0}, {0, 1, 1}}).empty());
}

TEST_CASE("Concave polygons are covered once, whichever corner comes first", "[triangulation]") {
  const Polygon shapes[] = {{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}},
                            {{0, 0}, {4, 0}, {4, 3}, {3, 3}, {3, 1}, {1, 1}, {1, 3}, {0, 3}},
                            {{0, 0}, {2, 1}, {4, 0}, {2, 4}},
                            {{0, 0}, {1, 0}, {2, 0}, {3, 0}, {3, 3}, {2, 1}, {1, 3}, {1, 2}, {1, 1}, {0, 3}}};
  for (Polygon polygon : shapes)
    for (size_t i = 0; i < polygon.size(); ++i) {
      CheckCovers(polygon);
      CheckCovers(Reversed(polygon));
      std::ranges::rotate(polygon, polygon.begin() + 1);
    }
}

TEST_CASE("Polygons in any plane are split alike", "[triangulation]") {
  Triangulator triangulator;
  for (int axis = 0; axis < 3; ++axis)
    for (const float way : {1.0f, -1.0f}) {
      std::vector<glm::vec3> corners;
      for (const glm::vec2& p : Polygon{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}) {
        glm::vec3 corner;
        corner[axis] = 0.1f * p.x + 1000;
        corner[(axis + 1) % 3] = p.x * way;
        corner[(axis + 2) % 3] = p.y;
        corners.push_back(corner);
      }
      std::ranges::rotate(corners, corners.begin() + 1);
      const auto triangles = triangulator.Split(corners);
      REQUIRE(triangles.size() == 4);
      double area = 0;
      for (const auto& t : triangles) {
        const glm::dvec3 a = glm::dvec3(corners[t.b]) - glm::dvec3(corners[t.a]),
                         b = glm::dvec3(corners[t.c]) - glm::dvec3(corners[t.a]);
        area += std::fabs(a[(axis + 1) % 3] * b[(axis + 2) % 3] - a[(axis + 2) % 3] * b[(axis + 1) % 3]) / 2;
      }
      CHECK(area == Approx(3));
    }
}

TEST_CASE("Random simple polygons are covered once", "[triangulation]") {
  std::mt19937 chance(7);
  int tried = 0;
  for (int i = 0; i < 400; ++i) {
    const auto corners = 4 + static_cast<uint32_t>(chance() % 30);
    CheckCovers(RandomStar(chance, corners, 0.1f));
    // On few places many corners lie on lines of others.
    const Polygon polygon = RandomSimple(chance, corners, i % 2 ? 8 : 1000);
    if (polygon.empty()) continue;
    ++tried;
    CheckCovers(polygon);
    CheckCovers(Reversed(polygon));
  }
  CHECK(tried > 200);
}

TEST_CASE("Holes by keyholes stay holes", "[triangulation]") {
  for (const auto& [columns, rows] : {std::pair(1, 1), {3, 1}, {1, 3}, {5, 4}, {20, 20}}) {
    Polygon polygon = Keyholes(columns, rows);
    CHECK(AreaOf(polygon) == Approx(12.0 * columns * rows));
    for (int turn = 0; turn < 5; ++turn) {
      CheckCovers(polygon);
      CheckCovers(Reversed(polygon));
      std::ranges::rotate(polygon, polygon.begin() + static_cast<long>(polygon.size()) / 5 + 1);
    }
  }
}

TEST_CASE("Polygons that cross themselves, or are degenerate, become as many triangles", "[triangulation]") {
  std::mt19937 chance(3);
  Triangulator triangulator;
  const auto check = [&](const std::vector<glm::vec3>& corners) {
    const auto triangles = triangulator.Split(corners);
    if (triangles.empty()) return;
    REQUIRE(triangles.size() == corners.size() - 2);
    for (const auto& t : triangles) REQUIRE(std::max({t.a, t.b, t.c}) < corners.size());
  };
  for (int i = 0; i < 3000; ++i) {
    std::vector<glm::vec3> corners(4 + chance() % 40);
    const int kind = i % 6;
    for (glm::vec3& p : corners)
      for (int a = 0; a < 3; ++a) {
        const auto random = static_cast<float>(chance() % 10000) / 100;
        p[a] = kind == 0   ? random
               : kind == 1 ? std::floor(random / 40)
               : kind == 2 ? (a == 0 ? random : 0)
               : kind == 3 ? 1
                           : random * 1e36f;
        if (kind == 5 && chance() % 30 == 0) p[a] = chance() % 2 ? NAN : INFINITY;
      }
    check(corners);
  }
  check({});
  check(std::vector<glm::vec3>(3));
}

TEST_CASE("Polygons of 60,000 corners are split too", "[triangulation][long]") {
  std::mt19937 chance(5);
  constexpr uint32_t kCorners = 60000;
  Polygon comb, spiral, crossing, far = RandomStar(chance, kCorners, 0.01f);
  for (uint32_t i = 0; i < kCorners / 4; ++i)
    for (const auto& [x, y] : {std::pair(0.0f, 0.0f), {1.0f, 1.0f}, {2.0f, 1.0f}, {3.0f, 0.0f}})
      comb.emplace_back(4 * static_cast<float>(i) + x + 1000 * y, 1000 * y - 1000 * x / 4);
  comb.emplace_back(240000, -20000);
  for (uint32_t i = 0; i < kCorners; ++i) {
    const uint32_t k = i < kCorners / 2 ? i : kCorners - 1 - i;
    const double angle = 0.01 * k, r = angle + (i < kCorners / 2 ? 0 : 2);
    spiral.emplace_back(r * std::cos(angle), r * std::sin(angle));
  }
  for (glm::vec2& p : far) p = p * p * p * p * p * p * p * 1e-3f;
  far[17] = {1e9f, 1e9f};
  for (uint32_t i = 0; i < kCorners; ++i) crossing.emplace_back(chance() % 100000, chance() % 100000);
  for (const Polygon& simple :
       {RandomStar(chance, kCorners, 0.01f), RandomStar(chance, kCorners, 0.99f), Keyholes(99, 99), spiral})
    CheckCovers(simple);
  for (const Polygon& any : {comb, crossing, far}) CHECK(TrianglesOf(any).size() == any.size() - 2);
}

}  // namespace quarry

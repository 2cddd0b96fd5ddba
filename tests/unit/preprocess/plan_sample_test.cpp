#include "preprocess/estimate/plan_sample.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <numeric>

namespace quarry {
namespace {

/// Vertices of a grid of so many a side, a unit apart, row by row.
VertexSample Grid(uint32_t side) {
  VertexSample sample;
  for (uint32_t y = 0; y < side; ++y)
    for (uint32_t x = 0; x < side; ++x) sample.Add({x, y, 0});
  return sample;
}

}  // namespace

TEST_CASE("A sample of vertices is spread evenly, however many come, and finite", "[plan]") {
  const VertexSample sample = Grid(1000);
  CHECK(sample.points().size() > 30000);
  CHECK(sample.points().size() < 65536);
  const double mean = std::accumulate(sample.points().begin(), sample.points().end(), 0.0,
                                      [](double sum, const glm::dvec3& p) { return sum + p.y; }) /
                      static_cast<double>(sample.points().size());
  CHECK(mean == Approx(500).epsilon(0.02));
  VertexSample broken;
  broken.Add({NAN, 0, 0});
  broken.Add({0, INFINITY, 0});
  CHECK(broken.points().empty());
  CHECK(ChooseWindows(broken, 1000).empty());
}

TEST_CASE("Windows hold their share of a large file, and all of a small one", "[plan]") {
  const VertexSample sample = Grid(1000);
  const auto windows = ChooseWindows(sample, 2'000'000);
  REQUIRE(windows.size() == 4);
  for (const SampleWindow& window : windows) {
    const auto inside = std::ranges::count_if(sample.points(), [&](auto& p) { return window.Holds(p); });
    // 64 thousand of 2 million; many points of a grid are equally far.
    CHECK(static_cast<double>(inside) / static_cast<double>(sample.points().size()) ==
          Approx(65536.0 / 2e6).epsilon(0.1));
  }
  const auto whole = ChooseWindows(sample, 1000);
  REQUIRE(whole.size() == 1);
  CHECK(whole[0].Holds({1e30, -1e30, 0}));
}

TEST_CASE("Elements of a stream are picked by their indices", "[plan]") {
  Picked<int> picked({7, 2, 2, 100});
  CHECK(picked.wants_any());
  for (int i = 0; i < 10; ++i) picked.Offer(10 * i);
  REQUIRE(picked.Find(2));
  CHECK((*picked.Find(2) == 20 && *picked.Find(7) == 70));
  CHECK((!picked.Find(3) && !picked.Find(100) && !picked.Find(kNoIndex)));
  CHECK_FALSE(Picked<int>({}).wants_any());
}

TEST_CASE("A triangle that leaves a window is resolved with all its corners", "[plan]") {
  const std::vector<SampleWindow> windows{{{0, 0, 0}, 1}};
  const auto give = [](ModelSink& sink) {
    REQUIRE(sink.BeginFile("a"));
    for (const double x : {0.0, 0.5, 50.0, 60.0, 70.0}) REQUIRE(sink.AddPosition({x, 0, 0}, {}));
    REQUIRE(sink.AddNormal({0, 0, 1}));
    REQUIRE(sink.AddNormal({0, 1, 0}));
    const Corner reaching[] = {{0, 1}, {1, 1}, {2, 1}}, beyond[] = {{2, 0}, {3, 0}, {4, 0}},
                 broken[] = {{0}, {1}, {99}};
    for (const std::span<const Corner> corners : {std::span(reaching), std::span(beyond), std::span(broken)})
      REQUIRE(sink.AddPolygon(corners, kNoIndex, kNoIndex));
    REQUIRE(sink.EndFile());
  };
  WindowSink content(0, windows, 5);
  give(content);
  REQUIRE(content.triangles().size() == 2);
  CHECK((content.triangles()[0].id == 0 && content.triangles()[1].id == 2));
  CornerSink corners(0, content);
  REQUIRE(corners.wants_any());
  give(corners);
  glm::dvec3 positions[3];
  TriangleRecord record;
  REQUIRE(corners.Resolve(content.triangles()[0], positions, record));
  CHECK((positions[0].x == 0 && positions[1].x == 0.5 && positions[2].x == 50));
  CHECK(record.normals[2] == glm::vec3(0, 1, 0));
  CHECK_FALSE(corners.Resolve(content.triangles()[1], positions, record));
}

}  // namespace quarry

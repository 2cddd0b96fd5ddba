#include "preprocess/partition/voxel_chain.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <vector>

#include "preprocess/partition/split.h"

namespace quarry {
namespace {

constexpr uint32_t kMost = 100;
const Box kCell{glm::vec3(0), glm::vec3(10)};

KdReference Reference(uint32_t id, const glm::vec3& lower, const glm::vec3& upper) {
  return {{lower.x, lower.y, lower.z}, id, {upper.x, upper.y, upper.z}, 0};
}

/// Alternating bars along x and along y, over one another; the bars along x reach beyond the cell.
std::vector<KdReference> CrossingBars(uint32_t count) {
  std::vector<KdReference> bars;
  for (uint32_t i = 0; i < count; ++i) {
    const float at = 10 * static_cast<float>(i) / static_cast<float>(count);
    bars.push_back(i % 2 != 0 ? Reference(i, {-5, at, 1}, {20, at + 0.01f, 1.1f})
                              : Reference(i, {at, 0, 1}, {at + 0.01f, 10, 1.1f}));
  }
  return bars;
}

/// Splits the references and checks the invariants of groups. Returns the sum of the groups' areas over the
/// cell's.
double AreasOfGroups(std::vector<KdReference>& references) {
  const size_t count = references.size();
  const std::vector<size_t> ends = SplitIntoChain(references, kCell, kMost);
  REQUIRE(!ends.empty());
  CHECK(ends.back() == count);
  double areas = 0;
  size_t begin = 0, smallest = count;
  for (const size_t end : ends) {
    REQUIRE(end > begin);
    REQUIRE(end - begin <= kMost);
    smallest = std::min(smallest, end - begin);
    areas +=
        static_cast<double>(ContentOf(std::span(references).subspan(begin, end - begin), kCell).half_area());
    begin = end;
  }
  CHECK(smallest >= std::min<size_t>(count, kMost / 4));
  std::vector<bool> seen(count);
  for (const KdReference& r : references) seen[r.triangle] = true;
  CHECK(std::find(seen.begin(), seen.end(), false) == seen.end());
  const Box content = ContentOf(references, kCell);
  return areas / static_cast<double>(content.half_area());
}

}  // namespace

TEST_CASE("A leaf of crossing bars is split into strips along them") {
  std::vector<KdReference> bars = CrossingBars(2000);
  // 20 groups or more: in any order they would take 20 times the area; strips take it twice, and some more
  // for borders.
  CHECK(AreasOfGroups(bars) < 4);
}

TEST_CASE("A leaf in one place, or of a few triangles, is split by numbers alone") {
  for (const auto& [count, groups] : {std::pair(1050u, 11), std::pair(kMost, 1), std::pair(kMost + 1, 2)}) {
    std::vector<KdReference> heap;
    for (uint32_t i = 0; i < count; ++i) heap.push_back(Reference(i, {1, 2, 3}, {4, 5, 6}));
    CHECK(AreasOfGroups(heap) == Approx(groups));
  }
}

}  // namespace quarry

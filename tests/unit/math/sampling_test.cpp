#include "common/math/sampling.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <glm/geometric.hpp>
#include <set>
#include <vector>

namespace quarry {

TEST_CASE("Samples of a pixel are stratified in every elementary interval, for each pair of dimensions") {
  for (const uint32_t dimension : {4u, 6u, 20u, 16u * 7 + 4})
    for (uint32_t k = 1; k <= 8; ++k)
      for (uint32_t a = 0; a <= k; ++a) {
        std::set<std::pair<int, int>> cells;
        for (uint32_t i = 0; i < 1u << k; ++i) {
          const glm::vec2 u = SobolSample(7, 12345, i, dimension);
          REQUIRE((u.x >= 0 && u.x < 1 && u.y >= 0 && u.y < 1));
          cells.emplace(static_cast<int>(std::ldexp(u.x, static_cast<int>(a))),
                        static_cast<int>(std::ldexp(u.y, static_cast<int>(k - a))));
        }
        REQUIRE(cells.size() == 1u << k);
      }
}

TEST_CASE("Samples differ between pixels, seeds and dimensions") {
  const glm::vec2 one = SobolSample(1, 2, 3, 4);
  CHECK(SobolSample(1, 2, 3, 4) == one);
  CHECK(SobolSample(2, 2, 3, 4) != one);
  CHECK(SobolSample(1, 3, 3, 4) != one);
  CHECK(SobolSample(1, 2, 4, 4) != one);
  CHECK(SobolSample(1, 2, 3, 6) != one);
}

TEST_CASE("Sobol's second dimension in five steps is the one in 32") {
  for (uint32_t i = 0; i < 100000; ++i) {
    const uint32_t n = i * 2654435761u;
    REQUIRE(ReversedSobol2(n) == ReverseBits(Sobol2(n)));
  }
}

TEST_CASE("Directions have a density by the cosine, around any normal") {
  constexpr uint32_t kCount = 1 << 14;
  for (const glm::vec3& n :
       {glm::vec3(0, 0, 1), glm::vec3(0, 0, -1), glm::normalize(glm::vec3(1, -2, 3)), glm::vec3(-1, 0, 0)}) {
    double mean_cosine = 0, outer = 0;
    for (uint32_t i = 0; i < kCount; ++i) {
      const glm::vec3 d = CosineDirection(n, SobolSample(0, 9, i, 4));
      const double cosine = static_cast<double>(glm::dot(d, n));
      REQUIRE(std::fabs(static_cast<double>(glm::dot(d, d)) - 1) < 1e-5);
      REQUIRE(cosine > -1e-6);
      mean_cosine += cosine / kCount;
      outer += (cosine < 0.5) / static_cast<double>(kCount);
    }
    CHECK(mean_cosine == Approx(2.0 / 3).epsilon(1e-3));
    CHECK(outer == Approx(0.25).epsilon(1e-2));
  }
}

TEST_CASE("The disk is covered evenly, and its middle is the square's") {
  CHECK(ConcentricDisk({0.5f, 0.5f}) == glm::vec2(0, 0));
  for (uint32_t i = 0; i < 4096; ++i) {
    const glm::vec2 u = SobolSample(3, 4, i, 8), p = ConcentricDisk(u);
    const double a = 2.0 * u.x - 1, b = 2.0 * u.y - 1, radius = std::max(std::fabs(a), std::fabs(b));
    REQUIRE(std::sqrt(static_cast<double>(glm::dot(p, p))) == Approx(radius).margin(1e-6));
  }
}

}  // namespace quarry

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <random>
#include <set>

#include "common/math/elementary.h"
#include "common/math/fixed_radiance.h"
#include "common/math/sampling.h"

namespace quarry {
namespace {

double RelativeError(double a, double b) { return std::fabs(a - b) / std::max(std::fabs(b), 1e-300); }

}  // namespace

TEST_CASE("Elementary functions are within 2e-10 of libm") {
  std::mt19937_64 random(1);
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random() >> 11) * 0x1p-53;
  };
  double worst = 0;
  for (int i = 0; i < 200000; ++i) {
    const double x = uniform(-100, 100), positive = std::exp2(uniform(-60, 60)), angle = uniform(-1000, 1000);
    worst = std::max(worst, RelativeError(Exp2(x), std::exp2(x)));
    worst = std::max(worst, std::fabs(Log2(positive) - std::log2(positive)));
    worst = std::max(worst, RelativeError(Pow(positive, 2.4), std::pow(positive, 2.4)));
    double s = 0, c = 0;
    SinCos(angle, s, c);
    worst = std::max({worst, std::fabs(s - std::sin(angle)), std::fabs(c - std::cos(angle))});
    const double degrees = uniform(0.1, 179);
    worst = std::max(worst, RelativeError(TanHalfDegrees(degrees), std::tan(degrees * M_PI / 360)));
  }
  CHECK(worst < 2e-10);
  CHECK(Pow(0, 2) == 0);
  CHECK(Pow(0, 0) == 1);
  CHECK(EncodeSrgb(-1) == 0);
  CHECK(EncodeSrgb(std::nan("")) == 0);
  CHECK(EncodeSrgb(2) == 1);
  CHECK(EncodeSrgb(0.5) == Approx(0.7353569831));
}

TEST_CASE("Sample 0 is the pixel's centre, whatever seed and pixel") {
  for (uint32_t pixel : {0u, 1u, 77777u})
    for (uint64_t seed : {0ull, 9ull}) CHECK(PixelSample(seed, pixel, 0) == glm::vec2(0.5f));
}

TEST_CASE("The first 2^k samples are stratified in every elementary interval") {
  for (uint32_t pixel = 0; pixel < 50; ++pixel)
    for (int k = 1; k <= 8; ++k)
      for (int kx = 0; kx <= k; ++kx) {
        std::set<std::pair<int, int>> cells;
        for (uint32_t i = 0; i < 1u << k; ++i) {
          const glm::vec2 p = PixelSample(3, pixel, i);
          REQUIRE((p.x >= 0 && p.x < 1 && p.y >= 0 && p.y < 1));
          cells.emplace(static_cast<int>(p.x * static_cast<float>(1 << kx)),
                        static_cast<int>(p.y * static_cast<float>(1 << (k - kx))));
        }
        REQUIRE(cells.size() == size_t{1} << k);
      }
}

TEST_CASE("Pixels and seeds have samples of their own") {
  CHECK(PixelSample(0, 1, 3) != PixelSample(0, 2, 3));
  CHECK(PixelSample(0, 1, 3) != PixelSample(1, 1, 3));
}

TEST_CASE("Random bits depend on every part of their key") {
  const RandomKey key{1, 2, 3, 4};
  const uint32_t bits = RandomBits(key, 5);
  CHECK(bits == RandomBits(key, 5));
  CHECK(bits != RandomBits({2, 2, 3, 4}, 5));
  CHECK(bits != RandomBits({1, 3, 3, 4}, 5));
  CHECK(bits != RandomBits({1, 2, 4, 4}, 5));
  CHECK(bits != RandomBits({1, 2, 3, 5}, 5));
  CHECK(bits != RandomBits(key, 6));
  CHECK(ReflectedPath(kPrimaryPath) != RefractedPath(kPrimaryPath));
}

TEST_CASE("Radiance does not depend on the order of its terms, saturation and all") {
  std::mt19937 random(5);
  std::vector<float> terms;
  for (int i = 0; i < 3000; ++i)
    terms.push_back(std::ldexp(static_cast<float>(random() >> 8), static_cast<int>(random() % 44) - 44));
  for (int round = 0; round < 20; ++round) {
    FixedRadiance a, b;
    for (float t : terms) a.Add(t);
    std::shuffle(terms.begin(), terms.end(), random);
    for (float t : terms) b.Add(t);
    CHECK(a.Mean(7) == b.Mean(7));
  }
  FixedRadiance full;
  for (int i = 0; i < 5000; ++i) full.Add(1e30f);
  CHECK(full.Mean(1) == 0x1p30f);
  FixedRadiance none;
  none.Add(std::nanf(""));
  none.Add(-1);
  CHECK(none.Mean(1) == 0);
}

}  // namespace quarry

#include "common/voxel/environment/sky_table.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <numbers>
#include <random>

#include "common/math/elementary.h"

namespace quarry {
namespace {

bool Holds(const SkyCells::Rect& r, uint32_t x, uint32_t y) {
  return x >= r.x0 && x < r.x1 && y >= r.y0 && y < r.y1;
}

/// A sky with a few bright cells, which are divided.
SkyTable MadeTable(uint32_t width) {
  const SkyCells cells(width);
  std::mt19937 random(width);
  std::exponential_distribution<double> weight;
  std::vector<double> weights;
  for (uint32_t cell = 0; cell < cells.count(); ++cell)
    weights.push_back(cell % 7 == 0 ? 0 : weight(random) * (cell % 101 == 5 ? 1000 : 1));
  std::vector<SkyTable::Divided> divided;
  for (uint32_t cell = 5; cell < cells.count() && divided.size() < 100; cell += 101) {
    if (cells.PartsOf(cell) < 2 || weights[cell] == 0) continue;
    divided.push_back({cell, {}});
    for (uint32_t part = 0; part < cells.PartsOf(cell); ++part)
      divided.back().weights.push_back(part % 3 == 1 ? 0 : weight(random));
  }
  return SkyTable(cells, {-3, glm::vec3(1, 2, 3), 100}, weights, divided);
}

}  // namespace

TEST_CASE("Each texel of a sky lies in one cell and one part", "[sky]") {
  for (const uint32_t width : {2u, 6u, 510u, 512u, 514u, 1026u, 6000u, 32768u}) {
    const SkyCells cells(width);
    double all = 0;
    for (uint32_t cell = 0; cell < cells.count(); ++cell) all += cells.SolidAngle(cells.RectOf(cell));
    CHECK(all == Approx(4 * std::numbers::pi).epsilon(1e-9));
    std::mt19937 random(width);
    int wrong = 0;
    for (int i = 0; i < 2000; ++i) {
      const uint32_t x = random() % width, y = random() % (width / 2), cell = cells.CellOf(x, y);
      const SkyCells::Rect whole = cells.RectOf(cell);
      const uint32_t part = cells.PartOf(cell, x, y);
      wrong += !Holds(whole, x, y) || part >= cells.PartsOf(cell) || !Holds(cells.RectOf(cell, part), x, y);
    }
    CHECK(wrong == 0);
  }
}

TEST_CASE("A sky's table chooses places as often as it says", "[sky]") {
  for (const uint32_t width : {64u, 2048u}) {
    const SkyTable table = MadeTable(width);
    const uint32_t columns = table.cells().columns();
    constexpr uint32_t kDraws = 1u << 22;
    std::vector<double> drawn(table.cells().count()), expected(table.cells().count());
    std::mt19937 random(1);
    int wrong = 0;
    for (uint32_t i = 0; i < kDraws; ++i) {
      const SkyTable::Choice c = table.Chosen(static_cast<float>(random() >> 8) * 0x1p-24f);
      const SkyTable::Choice again = table.Around(c.rect.x1 - 1, c.rect.y1 - 1);
      wrong += c.rect != again.rect || c.chance != again.chance || !(c.chance > 0);
      drawn[table.cells().CellOf(c.rect.x0, c.rect.y0)] += 1;
    }
    CHECK(wrong == 0);
    for (uint32_t cell = 0; cell < expected.size(); ++cell) {
      const SkyCells::Rect r = table.cells().RectOf(cell);
      const SkyTable::Choice first = table.Around(r.x0, r.y0);
      if (first.rect == r) {
        expected[cell] = static_cast<double>(first.chance) * kDraws;
        continue;
      }
      for (uint32_t part = 0; part < table.cells().PartsOf(cell); ++part) {
        const SkyCells::Rect p = table.cells().RectOf(cell, part);
        expected[cell] += static_cast<double>(table.Around(p.x0, p.y0).chance) * kDraws;
      }
    }
    double chi = 0, freedoms = 0;
    for (size_t cell = 0; cell < expected.size(); ++cell) {
      if (expected[cell] == 0) CHECK(drawn[cell] == 0);
      if (expected[cell] < 8) continue;
      chi += (drawn[cell] - expected[cell]) * (drawn[cell] - expected[cell]) / expected[cell];
      freedoms += 1;
    }
    CHECK(freedoms > columns);
    CHECK(std::fabs(chi - freedoms) < 5 * std::sqrt(2 * freedoms));
  }
}

TEST_CASE("A sky's section is read as it was written, and damage is refused", "[sky]") {
  for (const uint32_t width : {2u, 64u, 1026u, 4096u}) {
    const SkyTable table = MadeTable(width == 2 ? 4 : width);
    const uint32_t wide = table.cells().width();
    const Bytes bytes = table.Encode();
    const auto read = SkyTable::Decode(bytes, wide);
    REQUIRE(read.has_value());
    CHECK(read->Encode() == bytes);
    CHECK(read->facts() == table.facts());
    if (wide < SkyCells::kMostColumns) CHECK_FALSE(SkyTable::Decode(bytes, wide + 2).has_value());
    CHECK_FALSE(SkyTable::Decode(std::span(bytes).first(bytes.size() - 1), wide).has_value());
    std::mt19937 random(7);
    int taken = 0;
    for (int i = 0; i < 200; ++i) {
      Bytes damaged = bytes;
      // The numbers begin after the facts; each bit of them counts.
      const size_t at = 20 + random() % (damaged.size() - 20);
      damaged[at] ^= static_cast<std::byte>(1u << random() % 8);
      taken += SkyTable::Decode(damaged, wide).has_value();
    }
    CHECK(taken == 0);
    for (const size_t at : {4u, 16u}) {  // the mean and the brightest: not a number
      Bytes damaged = bytes;
      const float nan = std::nanf("");
      std::memcpy(&damaged[at], &nan, sizeof nan);
      CHECK_FALSE(SkyTable::Decode(damaged, wide).has_value());
    }
  }
}

TEST_CASE("The angle of a point is that of the standard library", "[math]") {
  std::mt19937 random(3);
  std::normal_distribution<double> number;
  double worst = 0;
  for (int i = 0; i < 100000; ++i) {
    const double scale = std::exp(4 * number(random)), y = number(random), x = number(random) * scale;
    const double is = std::atan2(y, x);
    worst = std::max(worst, std::fabs(ArcTan2(y, x) - is) / std::fabs(is));
  }
  CHECK(worst < 2e-10);
  CHECK(ArcTan2(0, 0) == 0);
  CHECK(ArcTan2(0, 1) == 0);
  CHECK(ArcTan2(0, -1) == Approx(std::numbers::pi));
  CHECK(ArcTan2(-1, 0) == Approx(-std::numbers::pi / 2));
}

}  // namespace quarry

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

constexpr float kDeckThickness = 0.06f;

/// One bay of grating: bearing bars along y and cross bars along x; a slab where there are too few triangles
/// for bars.
void DrawGrating(Plant& plant, const vec3& corner, double triangles, Random& random) {
  Builder& b = plant.b;
  b.Use(kGalvanised, Worn(random) * 0.8f);
  const float top = corner.z, gap = 0.02f;
  const float x0 = corner.x + gap, x1 = corner.x + kBay - gap, y0 = corner.y + gap,
              y1 = corner.y + kBay - gap;
  const int bars = static_cast<int>(triangles / 12.0);
  if (bars < 24) return Box(b, {x0, y0, top - kDeckThickness}, {x1, y1, top});
  const int cross = bars / 5, bearing = bars - cross;
  const float bearing_step = (x1 - x0) / static_cast<float>(bearing),
              cross_step = (y1 - y0) / static_cast<float>(cross);
  const float bearing_half = std::min(0.04f, 0.18f * bearing_step),
              cross_half = std::min(0.03f, 0.15f * cross_step);
  for (int i = 0; i < bearing; ++i) {
    const float x = x0 + bearing_step * (static_cast<float>(i) + 0.5f);
    Box(b, {x - bearing_half, y0, top - kDeckThickness}, {x + bearing_half, y1, top});
  }
  for (int i = 0; i < cross; ++i) {
    const float y = y0 + cross_step * (static_cast<float>(i) + 0.5f);
    Box(b, {x0, y - cross_half, top - 0.6f * kDeckThickness}, {x1, y + cross_half, top - 0.003f});
  }
}

bool HasDeck(int x, int y) { return !InHall(x, y) && !InStairs(x, y); }

void DrawGratings(Plant& plant, Budget budget) {
  constexpr int kDecks = (kLevels - 1) * (kBaysX * kBaysY - 16 - 2);
  int done = 0;
  for (int level = 1; level < kLevels; ++level)
    for (int y = 0; y < kBaysY; ++y)
      for (int x = 0; x < kBaysX; ++x) {
        if (!HasDeck(x, y)) continue;
        Random random(plant.seed, 40, static_cast<uint64_t>(level), static_cast<uint64_t>(y * 16 + x));
        const double share = budget.Share(static_cast<uint64_t>(kDecks - done++));
        if (share < 12) return;
        plant.b.Part(fmt::format("grating {},{} of level {}", x, y, level));
        DrawGrating(
            plant,
            {kBay * static_cast<float>(x), kBay * static_cast<float>(y), kLevel * static_cast<float>(level)},
            share, random);
      }
}

/// Floors of a plant too small for gratings: four slabs around the hall.
void DrawSlabs(Plant& plant, Budget budget) {
  const int step = budget.Room() >= 48 * 9 ? 1 : (budget.Room() >= 48 * 4 ? 2 : 5);
  for (int level = step; level < kLevels && budget.Room() >= 48; level += step) {
    const float z = kLevel * static_cast<float>(level), low = z - 0.15f;
    plant.b.Part(fmt::format("floor of level {}", level));
    plant.b.Use(kConcrete);
    Box(plant.b, {0, 0, low}, {45, 10, z});
    Box(plant.b, {0, 30, low}, {50, 40, z});
    Box(plant.b, {0, 10, low}, {15, 30, z});
    Box(plant.b, {35, 10, low}, {50, 30, z});
  }
}

/// A railing from `from` to `to` on the floor: posts and three rails.
void DrawRailing(Plant& plant, const vec3& from, const vec3& to, double triangles) {
  const float length = glm::distance(from, to);
  TubeStyle rail{.radius = 0.024f, .segments = SegmentsFor(0.4 * triangles / 3, 2, 12), .bend_steps = 1};
  const std::array<float, 3> heights{0.35f, 0.7f, 1.1f};
  for (float height : heights) {
    const std::array<vec3, 2> line{from + vec3(0, 0, height), to + vec3(0, 0, height)};
    Tube(plant.b, line, rail);
  }
  const int posts = std::clamp(static_cast<int>(length / 1.25f), 2, 40);
  const int segments = SegmentsFor(0.6 * triangles / posts, 2, 10);
  for (int i = 0; i <= posts; ++i) {
    const vec3 foot = glm::mix(from, to, static_cast<float>(i) / static_cast<float>(posts));
    Cylinder(plant.b, foot, foot + vec3(0, 0, 1.08f), 0.03f, segments);
  }
}

void DrawRailings(Plant& plant, Budget budget) {
  const std::array<vec3, 5> corners{
      vec3(15.4f, 9.6f, 0), {34.6f, 9.6f, 0}, {34.6f, 30.4f, 0}, {15.4f, 30.4f, 0}, {15.4f, 9.6f, 0}};
  for (int level = 1; level < kLevels; ++level)
    for (size_t side = 0; side < 4; ++side) {
      const double share = budget.Share(static_cast<uint64_t>(4 * (kLevels - level)) - side);
      if (share < 200) return;
      const vec3 lift(0, 0, kLevel * static_cast<float>(level));
      plant.b.Part(fmt::format("railing {} of level {}", side, level));
      plant.b.Use(kYellowPaint);
      DrawRailing(plant, corners[side] + lift, corners[side + 1] + lift, share);
    }
}

/// A flight of steps between stringers, rising along y.
void DrawFlight(Plant& plant, const vec3& from, const vec3& to, float width, double triangles) {
  Builder& b = plant.b;
  const vec3 side(0.5f * width, 0, 0);
  b.Use(kYellowPaint);
  Beam(b, from - side, to - side, 0.06f, 0.25f);
  Beam(b, from + side, to + side, 0.06f, 0.25f);
  const int steps = std::clamp(static_cast<int>((triangles - 120) / 12), 4, 22);
  b.Use(kGalvanised);
  const float tread = std::abs(to.y - from.y) / static_cast<float>(steps);
  for (int i = 0; i < steps; ++i) {
    const vec3 at = glm::mix(from, to, (static_cast<float>(i) + 0.5f) / static_cast<float>(steps));
    OrientedBox(b, at, {0.5f * width - 0.04f, 0, 0}, {0, 0.48f * tread, 0}, {0, 0, 0.02f});
  }
  if (triangles < 420) return;
  b.Use(kYellowPaint);
  for (const vec3& s : {-side, side}) {
    const std::array<vec3, 2> rail{from + s + vec3(0, 0, 1), to + s + vec3(0, 0, 1)};
    Tube(b, rail, {.radius = 0.024f, .segments = 6});
  }
}

void DrawStairs(Plant& plant, Budget budget) {
  for (int level = 0; level + 1 < kLevels; ++level) {
    const float z = kLevel * static_cast<float>(level);
    const double share = budget.Share(static_cast<uint64_t>(kLevels - 1 - level));
    if (share < 180) return;
    plant.b.Part(fmt::format("stairs from level {}", level));
    DrawFlight(plant, {46.4f, 1.2f, z}, {46.4f, 7.8f, z + 4}, 1.3f, 0.5 * share);
    DrawFlight(plant, {48.2f, 7.8f, z + 4}, {48.2f, 1.2f, z + 8}, 1.3f, 0.5 * share);
    plant.b.Use(kGalvanised);
    Box(plant.b, {45.6f, 7.9f, z + 3.9f}, {49.2f, 9.4f, z + 4});
    Box(plant.b, {45.1f, 0.35f, z + 7.9f}, {49.2f, 1.1f, z + 8});
  }
}

}  // namespace

void DrawFloors(Plant& plant, Budget budget) {
  if (budget.Room() < 14000) return DrawSlabs(plant, budget);
  DrawRailings(plant, budget.Next(0.15 * static_cast<double>(budget.Room())));
  DrawStairs(plant, budget.Next(0.06 * static_cast<double>(budget.Room())));
  DrawGratings(plant, budget);
}

}  // namespace quarry::scenes

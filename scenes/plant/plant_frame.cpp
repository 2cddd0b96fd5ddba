#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

constexpr float kColumn = 0.5f;

/// A corner of the bay grid that has a column; those in the walls stand just inside them.
bool HasColumn(int x, int y) { return !(x > 3 && x < 7 && y > 2 && y < 6); }
vec3 ColumnFoot(int x, int y) {
  const float inset = 0.5f * kColumn + 0.05f;
  return {std::clamp(kBay * static_cast<float>(x), inset, kSizeX - inset),
          std::clamp(kBay * static_cast<float>(y), inset, kSizeY - inset), 0};
}

/// Of a plant with few triangles only every other column stands.
int ColumnStride(const Plant& plant) {
  return plant.triangles < 12000 ? (plant.triangles < 4000 ? 5 : 2) : 1;
}

template <typename Visit>
void ForEachColumn(const Plant& plant, const Visit& visit) {
  const int stride = ColumnStride(plant);
  for (int y = 0; y <= kBaysY; y += std::min(stride, 4))
    for (int x = 0; x <= kBaysX; x += stride)
      if (HasColumn(x, y)) visit(x, y, ColumnFoot(x, y));
}

void DrawColumns(Plant& plant, Budget budget) {
  const bool fine = plant.triangles >= 250000;
  ForEachColumn(plant, [&](int x, int y, const vec3& foot) {
    Random random(plant.seed, 20, static_cast<uint64_t>(x * 100 + y));
    const int pieces = fine ? kLevels : 1;
    const float height = kSizeZ / static_cast<float>(pieces);
    for (int i = 0; i < pieces && budget.Room() > 44; ++i) {
      const vec3 from = foot + kUp * (height * static_cast<float>(i)), to = from + kUp * height;
      plant.b.Part(fmt::format("column {},{} piece {}", x, y, i));
      plant.b.Use(kBluePaint, Worn(random) * 0.8f);
      if (fine) {
        IBeam(plant.b, from, to, {1, 0, 0}, kColumn, kColumn);
      } else {
        Beam(plant.b, from, to, kColumn, kColumn);
      }
    }
  });
}

struct Girder {
  vec3 from, to;
};

/// The girders below the floor of a level, bay by bay, along x, then along y.
template <typename Visit>
void ForEachGirder(const Visit& visit) {
  for (int y = 0; y <= kBaysY; ++y)
    for (int x = 0; x < kBaysX; ++x)
      if (!(y > 2 && y < 6 && x > 2 && x < 7)) visit(Girder{ColumnFoot(x, y), ColumnFoot(x + 1, y)});
  for (int x = 0; x <= kBaysX; ++x)
    for (int y = 0; y < kBaysY; ++y)
      if (!(x > 3 && x < 7 && y > 1 && y < 6)) visit(Girder{ColumnFoot(x, y), ColumnFoot(x, y + 1)});
}

void DrawGirders(Plant& plant, Budget budget) {
  if (plant.triangles < 12000) return;
  const bool fine = plant.triangles >= 250000;
  for (int level = 1; level < kLevels; ++level) {
    int index = 0;
    ForEachGirder([&](const Girder& girder) {
      ++index;
      if (budget.Room() < 44) return;
      Random random(plant.seed, 21, static_cast<uint64_t>(level), static_cast<uint64_t>(index));
      // Ends stop at the faces of the columns, tops below the floor.
      const vec3 inset = glm::normalize(girder.to - girder.from) * (0.5f * kColumn);
      const vec3 lift = kUp * (kLevel * static_cast<float>(level) - 0.36f);
      plant.b.Part(fmt::format("girder {} of level {}", index, level));
      plant.b.Use(kBluePaint, Worn(random) * 0.75f);
      if (fine) {
        IBeam(plant.b, girder.from + lift + inset, girder.to + lift - inset, kUp, 0.28f, 0.5f);
      } else {
        Beam(plant.b, girder.from + lift + inset, girder.to + lift - inset, 0.28f, 0.5f);
      }
    });
  }
}

}  // namespace

void DrawFrame(Plant& plant, Budget budget) {
  DrawColumns(plant, budget);
  DrawGirders(plant, budget);
}

void DrawBolts(Plant& plant, Budget budget) {
  int columns = 0, done = 0;
  ForEachColumn(plant, [&](int, int, const vec3&) { ++columns; });
  ForEachColumn(plant, [&](int x, int y, const vec3& foot) {
    for (int level = 0; level < kLevels; ++level, ++done) {
      const Budget share = budget.Next(budget.Share(static_cast<uint64_t>(columns * kLevels - done)));
      if (share.Room() < kBoltTriangles) continue;
      // Two rows on each flange, from the foot upwards, as close as their number makes them.
      const auto count = static_cast<int>(share.Room() / kBoltTriangles);
      const float step = (kLevel - 1.2f) / static_cast<float>((count + 3) / 4);
      const float radius = std::min(0.03f, 0.4f * step);
      plant.b.Part(fmt::format("bolts of column {},{} level {}", x, y, level));
      Random random(plant.seed, 22, static_cast<uint64_t>(done));
      plant.b.Use(kGalvanised, Worn(random));
      for (int i = 0; i < count; ++i) {
        const float side = i & 1 ? 1.0f : -1.0f, row = i & 2 ? 0.16f : -0.16f;
        const float z = kLevel * static_cast<float>(level) + 0.1f + step * (static_cast<float>(i / 4) + 0.5f);
        Bolt(plant.b, foot + vec3(side * 0.5f * kColumn, row + random.Uniform(-0.01f, 0.01f), z),
             {side, 0, 0}, radius, 0.7f * radius);
      }
    }
  });
  // The rest is fewer than a bolt has, or the plant is too small for bolts: studs at the entrance.
  for (int i = 0; budget.Room() > 0; ++i) {
    plant.b.Part(fmt::format("bollard {}", i));
    plant.b.Use(kYellowPaint);
    const auto count = static_cast<int>(std::min<uint64_t>(budget.Room(), 24));
    Spike(plant.b, {-2.0f - 1.5f * static_cast<float>(i / 2), i % 2 ? 13.5f : 21.5f, 0.0f}, 0.15f, 1.0f,
          count);
  }
}

}  // namespace quarry::scenes

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec2;
using glm::vec3;

constexpr float kThickness = 0.3f;

/// A rectangle on a wall: u along it, v up.
struct Opening {
  float u0, u1, v0, v1;
  bool Contains(float u, float v) const { return u > u0 && u < u1 && v > v0 && v < v1; }
};

constexpr Opening kDoor{20.8f, 24.2f, 0.0f, 4.5f};

struct Wall {
  const char* name;
  vec3 origin, along;  ///< The lower inner corner, left when seen from outside.
  float length;
  bool door;
  vec3 Out() const { return glm::cross(along, kUp); }
  vec3 At(float u, float v, float depth) const { return origin + along * u + kUp * v + Out() * depth; }
};

constexpr std::array<Wall, 4> kWalls{{{"south", {0, 0, 0}, {1, 0, 0}, kSizeX, false},
                                      {"east", {kSizeX, 0, 0}, {0, 1, 0}, kSizeY, false},
                                      {"north", {kSizeX, kSizeY, 0}, {-1, 0, 0}, kSizeX, false},
                                      {"west", {0, kSizeY, 0}, {0, -1, 0}, kSizeY, true}}};

struct WallDetail {
  int columns, rows;  ///< Of windows.
  int ribs;           ///< Of the cladding per cell.
};

/// A row of the table for as many triangles as the shell may have.
WallDetail DetailFor(double triangles) {
  if (triangles < 700) return {1, 2, 0};
  if (triangles < 3000) return {2, 4, 0};
  if (triangles < 12000) return {4, 9, 0};
  const int ribs = static_cast<int>(triangles / (4 * 9 * 20 * 8.0) / 4.0);
  return {4, 9, std::clamp(ribs, 1, 40)};
}

std::vector<Opening> Windows(const Wall& wall, const WallDetail& detail) {
  std::vector<Opening> windows;
  const float width = wall.length / static_cast<float>(detail.columns);
  const float height = (kSizeZ - kLevel) / static_cast<float>(detail.rows);
  for (int row = 0; row < detail.rows; ++row)
    for (int column = 0; column < detail.columns; ++column) {
      const float u = width * (static_cast<float>(column) + 0.5f),
                  v = kLevel + height * (static_cast<float>(row) + 0.5f);
      windows.push_back({u - 0.27f * width, u + 0.27f * width, v - 0.14f * height, v + 0.2f * height});
    }
  return windows;
}

/// A strip of cladding from u0 to u1 that stands out in `ribs` ribs.
void DrawCladding(Builder& b, const Wall& wall, const Opening& cell, int ribs) {
  b.BeginShape();
  const float step = (cell.u1 - cell.u0) / static_cast<float>(std::max(1, 4 * ribs));
  uint32_t last = 0;
  const int strips = std::max(1, 4 * ribs);
  for (int i = 0; i <= strips; ++i) {
    const float u = i == strips ? cell.u1 : cell.u0 + step * static_cast<float>(i);
    const float depth = kThickness + (i % 4 >= 2 && ribs > 0 ? 0.04f : 0.0f);
    const uint32_t low = b.Vertex(wall.At(u, cell.v0, depth));
    b.Vertex(wall.At(u, cell.v1, depth));
    if (i > 0) b.Quad(last, low, low + 1, last + 1);
    last = low;
  }
}

void DrawReveal(Builder& b, const Wall& wall, const Opening& o) {
  const vec3 out = wall.Out() * kThickness, u = wall.along * (o.u1 - o.u0), v = kUp * (o.v1 - o.v0);
  const vec3 low = wall.At(o.u0, o.v0, 0);
  Sheet(b, low, out, u);      // Sill, facing up ...
  Sheet(b, low + v, u, out);  // ... lintel, down ...
  Sheet(b, low, v, out);      // ... and the sides, inwards.
  Sheet(b, low + u, out, v);
}

void DrawWindow(Builder& b, const Wall& wall, const Opening& o, bool mullions) {
  b.Use(kWhitePaint);
  DrawReveal(b, wall, o);
  b.Use(kPane);
  const vec3 center = wall.At(0.5f * (o.u0 + o.u1), 0.5f * (o.v0 + o.v1), 0.6f * kThickness);
  const vec3 half_u = wall.along * (0.5f * (o.u1 - o.u0) - 0.002f),
             half_v = kUp * (0.5f * (o.v1 - o.v0) - 0.002f);
  OrientedBox(b, center, half_u, half_v, wall.Out() * 0.01f);
  if (!mullions) return;
  b.Use(kGreyPaint);
  const vec3 behind = center - wall.Out() * 0.06f;
  for (int i = 1; i < 4; ++i) {
    const vec3 at = behind + half_u * (0.5f * static_cast<float>(i) - 1.0f);
    Beam(b, at - half_v, at + half_v, 0.06f, 0.06f);
  }
  Beam(b, behind - half_u, behind + half_u, 0.05f, 0.05f);
}

std::vector<float> Cuts(const std::vector<Opening>& openings, bool vertical, float end) {
  std::vector<float> cuts{0.0f, end};
  for (const Opening& o : openings) {
    cuts.push_back(vertical ? o.v0 : o.u0);
    cuts.push_back(vertical ? o.v1 : o.u1);
  }
  std::sort(cuts.begin(), cuts.end());
  cuts.erase(std::unique(cuts.begin(), cuts.end()), cuts.end());
  return cuts;
}

void DrawWall(Plant& plant, const Wall& wall, const WallDetail& detail) {
  std::vector<Opening> openings = Windows(wall, detail);
  const size_t windows = openings.size();
  if (wall.door) openings.push_back(kDoor);
  const std::vector<float> us = Cuts(openings, false, wall.length), vs = Cuts(openings, true, kSizeZ);
  for (size_t j = 0; j + 1 < vs.size(); ++j) {
    plant.b.Part(fmt::format("{} wall course {}", wall.name, j));
    Random random(plant.seed, 30, j, static_cast<uint64_t>(wall.name[0]));
    const vec3 tint = Worn(random);
    for (size_t i = 0; i + 1 < us.size(); ++i) {
      const Opening cell{us[i], us[i + 1], vs[j], vs[j + 1]};
      const float u = 0.5f * (cell.u0 + cell.u1), v = 0.5f * (cell.v0 + cell.v1);
      if (std::any_of(openings.begin(), openings.end(), [&](const Opening& o) { return o.Contains(u, v); }))
        continue;
      Opening outer = cell;  // The outer faces meet at the corners of the building.
      if (i == 0) outer.u0 -= kThickness;
      if (i + 2 == us.size()) outer.u1 += kThickness;
      plant.b.Use(kCladding, tint);
      DrawCladding(plant.b, wall, outer, detail.ribs);
      plant.b.Use(kConcrete, tint);
      Sheet(plant.b, wall.At(cell.u1, cell.v0, 0), -wall.along * (cell.u1 - cell.u0),
            kUp * (cell.v1 - cell.v0));
    }
  }
  for (size_t i = 0; i < windows; ++i) {
    plant.b.Part(fmt::format("{} window {}", wall.name, i));
    DrawWindow(plant.b, wall, openings[i], detail.rows >= 9);
  }
  if (!wall.door) return;
  plant.b.Part("door");
  plant.b.Use(kYellowPaint);
  DrawReveal(plant.b, wall, kDoor);
  plant.b.Use(kGreenPaint);  // The leaf, slid aside along the wall outside.
  OrientedBox(plant.b, wall.At(kDoor.u0 - 1.8f, 2.2f, kThickness + 0.2f), wall.along * 1.75f, kUp * 2.2f,
              wall.Out() * 0.06f);
}

void DrawGround(Plant& plant) {
  plant.b.Part("ground");
  plant.b.Use(kGravel);
  Box(plant.b, {-120, -100, -1}, {170, 140, 0});
  plant.b.Part("floor slab");
  plant.b.Use(kConcrete);
  Sheet(plant.b, {0, 0, 0.02f}, {kSizeX, 0, 0}, {0, kSizeY, 0});
  plant.b.Part("roof");
  plant.b.Use(kGreyPaint);
  Box(plant.b, {-0.4f, -0.4f, kSizeZ}, {kSizeX + 0.4f, kSizeY + 0.4f, kSizeZ + 0.5f});
}

/// White and red bands, each its own part; the last one turns in and goes down inside.
void DrawChimney(Plant& plant, double triangles) {
  constexpr int kBands = 8;
  const bool few = triangles < 600;
  const int bands = few ? 2 : kBands;
  const int segments = SegmentsFor(triangles, bands + 3, 128);
  const vec3 foot(82, 20, 0);
  const auto radius = [](float z) { return 5.0f - 2.0f * z / 130.0f; };
  for (int i = 0; i < bands; ++i) {
    const float z0 = 130.0f * static_cast<float>(i) / static_cast<float>(bands),
                z1 = z0 + 130.0f / static_cast<float>(bands);
    plant.b.Part(fmt::format("chimney band {}", i));
    plant.b.Use(i < bands / 2 ? kConcrete : (i % 2 ? kRedPaint : kWhitePaint));
    std::vector<vec2> profile{{radius(z0), z0}, {radius(z1), z1}};
    if (i + 1 == bands)
      profile.insert(profile.end(), {{radius(z1) - 0.5f, z1}, {radius(z0) - 0.5f, z0}, {0.0f, z0}});
    Lathe(plant.b, foot, kUp, profile, segments);
  }
}

void DrawRoofVents(Plant& plant, Budget budget) {
  for (int i = 0; i < 40 && budget.Room() > 0; ++i) {
    const double share = std::min(budget.Share(static_cast<uint64_t>(40 - i)), 3 * plant.item);
    if (share < 40) continue;
    Random random(plant.seed, 31, static_cast<uint64_t>(i));
    const vec3 foot(3.0f + 4.8f * static_cast<float>(i % 10), 5.0f + 10.0f * static_cast<float>(i / 10),
                    kSizeZ + 0.5f);
    const float r = random.Uniform(0.4f, 0.9f), h = random.Uniform(1.0f, 2.5f);
    const std::array<vec2, 7> profile{
        vec2{0, 0}, {r, 0}, {r, h}, {1.5f * r, h}, {1.5f * r, h + 0.5f * r}, vec2{0.4f * r, h + r},
        {0, h + r}};
    plant.b.Part(fmt::format("roof vent {}", i));
    plant.b.Use(kGalvanised, Worn(random));
    Lathe(plant.b, foot, kUp, profile, SegmentsFor(share, 6, 64));
  }
}

void DrawStorageTanks(Plant& plant, Budget budget) {
  constexpr std::array<vec3, 4> kPlaces{vec3(-35, 62, 9), {-8, 70, 7.5f}, {22, 68, 8}, {95, 75, 12}};
  for (size_t i = 0; i < kPlaces.size(); ++i) {
    const double share = std::min(budget.Share(kPlaces.size() - i), 8 * plant.item);
    if (share < 30) return;
    Random random(plant.seed, 32, i);
    const float r = kPlaces[i].z, h = r * random.Uniform(1.0f, 1.6f);
    const vec3 foot(kPlaces[i].x, kPlaces[i].y, 0);
    const std::array<vec2, 5> profile{
        vec2{r, 0}, {r, h}, {r + 0.15f, h}, {r + 0.15f, h + 0.2f}, {0, h + 0.25f * r}};
    plant.b.Part(fmt::format("storage tank {}", i));
    plant.b.Use(i % 2 ? kPolished : kWhitePaint, Worn(random));
    Lathe(plant.b, foot, kUp, profile, SegmentsFor(share, 4, 192));
  }
}

}  // namespace

void DrawShell(Plant& plant, Budget budget) {
  const double all = static_cast<double>(budget.Room());
  DrawGround(plant);
  DrawChimney(plant, 0.12 * all);
  const WallDetail detail = DetailFor(0.75 * all);
  for (const Wall& wall : kWalls) DrawWall(plant, wall, detail);
  DrawStorageTanks(plant, budget.Next(0.4 * static_cast<double>(budget.Room())));
  DrawRoofVents(plant, budget);
}

}  // namespace quarry::scenes

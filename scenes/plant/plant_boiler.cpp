#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

constexpr float kBottom = 9.0f, kTop = 66.0f, kDrumZ = 71.0f;

/// The casing of a boiler, from outside.
struct Boiler {
  int index;
  vec3 low, high;
  vec3 Middle() const { return 0.5f * (low + high); }
  /// Away from the other boiler, along x.
  float Side() const { return index == 0 ? -1.0f : 1.0f; }
};

constexpr std::array<Boiler, 2> kBoilers{
    {{0, {17.0f, 13.5f, kBottom}, {22.2f, 26.5f, kTop}}, {1, {27.8f, 13.5f, kBottom}, {33.0f, 26.5f, kTop}}}};

/// A box that narrows downwards, on legs: the ash hopper.
void DrawHopper(Plant& plant, const Boiler& boiler) {
  Builder& b = plant.b;
  b.Part(fmt::format("boiler {} hopper", boiler.index));
  b.Use(kRust);
  b.BeginShape();
  const vec3 middle = boiler.Middle();
  std::array<uint32_t, 8> v;
  for (uint32_t i = 0; i < 8; ++i) {
    const bool up = (i & 4) != 0;
    const vec3 corner(i & 1 ? boiler.high.x : boiler.low.x, i & 2 ? boiler.high.y : boiler.low.y, 0);
    vec3 at = up ? corner : glm::mix(corner, vec3(middle.x, middle.y, 0), 0.75f);
    at.z = up ? kBottom - 0.01f : 3.5f;
    v[i] = b.Vertex(at);
  }
  b.Quad(v[0], v[2], v[3], v[1]);
  b.Quad(v[4], v[5], v[7], v[6]);
  b.Quad(v[0], v[1], v[5], v[4]);
  b.Quad(v[2], v[6], v[7], v[3]);
  b.Quad(v[0], v[4], v[6], v[2]);
  b.Quad(v[1], v[3], v[7], v[5]);
}

void DrawLegs(Plant& plant, const Boiler& boiler) {
  for (int i = 0; i < 4; ++i) {
    plant.b.Part(fmt::format("boiler {} leg {}", boiler.index, i));
    plant.b.Use(kBluePaint);
    const vec3 foot(i & 1 ? boiler.high.x - 0.4f : boiler.low.x + 0.4f,
                    i & 2 ? boiler.high.y - 0.4f : boiler.low.y + 0.4f, 0);
    Beam(plant.b, foot, foot + vec3(0, 0, kBottom - 0.02f), 0.6f, 0.6f);
  }
}

/// The walls of the casing as single sheets, both sides seen: outside insulation, inside hidden behind the
/// tubes.
void DrawCasing(Plant& plant, const Boiler& boiler) {
  const vec3 wall(0.12f);
  const vec3 l = boiler.low, h = boiler.high;
  plant.b.Part(fmt::format("boiler {} casing", boiler.index));
  plant.b.Use(kInsulation, vec3(0.9f));
  Box(plant.b, l, {h.x, l.y + wall.y, h.z});
  Box(plant.b, {l.x, h.y - wall.y, l.z}, h);
  Box(plant.b, {l.x, l.y + wall.y, l.z}, {l.x + wall.x, h.y - wall.y, h.z});
  Box(plant.b, {h.x - wall.x, l.y + wall.y, l.z}, {h.x, h.y - wall.y, h.z});
  Box(plant.b, {l.x, l.y, h.z}, {h.x, h.y, h.z + 0.3f});
}

/// Belts of beams that keep the casing from bulging.
void DrawBuckstays(Plant& plant, const Boiler& boiler, Budget budget) {
  const int belts = std::min<int>(18, static_cast<int>(budget.Room() / (4 * 44)));
  for (int i = 0; i < belts; ++i) {
    const float z =
        glm::mix(kBottom + 1, kTop - 1, (static_cast<float>(i) + 0.5f) / static_cast<float>(belts));
    const float out = 0.2f;
    const vec3 l(boiler.low.x - out, boiler.low.y - out, z), h(boiler.high.x + out, boiler.high.y + out, z);
    plant.b.Part(fmt::format("boiler {} buckstay {}", boiler.index, i));
    plant.b.Use(kBluePaint, vec3(0.8f));
    IBeam(plant.b, {l.x - out, l.y, z}, {h.x + out, l.y, z}, {0, 1, 0}, 0.3f, 0.38f);
    IBeam(plant.b, {l.x - out, h.y, z}, {h.x + out, h.y, z}, {0, 1, 0}, 0.3f, 0.38f);
    IBeam(plant.b, {l.x, l.y + out, z}, {l.x, h.y - out, z}, {1, 0, 0}, 0.3f, 0.38f);
    IBeam(plant.b, {h.x, l.y + out, z}, {h.x, h.y - out, z}, {1, 0, 0}, 0.3f, 0.38f);
  }
}

/// Vertical tubes side by side inside the four walls.
void DrawTubeWalls(Plant& plant, const Boiler& boiler, Budget budget) {
  const auto count = static_cast<uint64_t>(static_cast<double>(budget.Room()) / (0.6 * plant.item));
  const vec3 l = boiler.low + vec3(0.35f), h = boiler.high - vec3(0.35f);
  const float wide = h.x - l.x, deep = h.y - l.y, around = 2 * (wide + deep);
  const float radius = std::min(0.09f, 0.45f * around / static_cast<float>(count + 1));
  for (uint64_t i = 0; i < count && budget.Room() > 0; ++i) {
    Random random(plant.seed, 50 + static_cast<uint64_t>(boiler.index), i);
    float s = around * (static_cast<float>(i) + 0.5f) / static_cast<float>(count);
    vec3 at = l;
    if (s < wide) {
      at.x += s;
    } else if ((s -= wide) < deep) {
      at = {h.x, l.y + s, 0};
    } else if ((s -= deep) < wide) {
      at = {h.x - s, h.y, 0};
    } else {
      at.y = h.y - (s - wide);
    }
    const std::array<vec3, 2> points{vec3(at.x, at.y, kBottom + random.Uniform(0.2f, 0.5f)),
                                     vec3(at.x, at.y, kTop - random.Uniform(0.2f, 0.5f))};
    plant.b.Part(fmt::format("boiler {} wall tube {}", boiler.index, i));
    plant.b.Use(kRust, Worn(random));
    TubeStyle style{.radius = radius,
                    .segments = std::clamp(static_cast<int>(std::sqrt(0.6 * plant.item / 3)), 3, 24)};
    style.leg_steps = std::clamp(static_cast<int>(0.3 * plant.item / style.segments) - 1, 1, 60);
    Tube(plant.b, points, style);
  }
}

/// The path of a superheater element: down and up between `low` and `high` across the depth of the boiler.
std::vector<vec3> Serpentine(float x, float low, float high, int passes, Random& random) {
  std::vector<vec3> points;
  const float y0 = kBoilers[0].low.y + 1.0f, y1 = kBoilers[0].high.y - 1.0f;
  const float top = high + random.Uniform(0.0f, 0.3f);
  for (int i = 0; i <= passes; ++i) {
    const float y = glm::mix(y0, y1, static_cast<float>(i) / static_cast<float>(passes));
    const float dip = low + random.Uniform(0.0f, 0.25f);
    points.emplace_back(x, y, i % 2 ? dip : top);
    points.emplace_back(x, y, i % 2 ? top : dip);
  }
  return points;
}

void DrawSuperheaters(Plant& plant, const Boiler& boiler, Budget budget) {
  constexpr std::array<glm::vec2, 6> kBanks{glm::vec2{12, 19}, {20, 27}, {28, 36},
                                            {37, 45},          {46, 54}, {55, 64}};
  const double cost = 3 * plant.item;
  for (size_t bank = 0; bank < kBanks.size(); ++bank) {
    const Budget share = budget.Next(budget.Share(kBanks.size() - bank));
    const auto count = static_cast<uint64_t>(static_cast<double>(share.Room()) / cost);
    const float x0 = boiler.low.x + 0.7f, x1 = boiler.high.x - 0.7f;
    const float step = (x1 - x0) / static_cast<float>(count + 1);
    const int passes = std::clamp(static_cast<int>(cost / 40), 2, 24);
    for (uint64_t i = 0; i < count && share.Room() > 0; ++i) {
      Random random(plant.seed, 60 + bank, i, static_cast<uint64_t>(boiler.index));
      const auto points =
          Serpentine(x0 + step * static_cast<float>(i + 1), kBanks[bank].x, kBanks[bank].y, passes, random);
      plant.b.Part(fmt::format("boiler {} superheater {} element {}", boiler.index, bank, i));
      plant.b.Use(i % 5 == 0 ? kChrome : kSteel, Worn(random));
      TubeStyle style{.radius = std::min(0.08f, 0.4f * step), .bend_radius = 0.22f, .segments = 32};
      style.bend_steps = cost > 2000 ? 4 : (cost > 600 ? 2 : 1);
      while (style.segments > 3 && TubeTriangles(static_cast<int>(points.size()), style) > cost)
        --style.segments;
      Tube(plant.b, points, style);
    }
  }
}

/// The steam drum above, risers into it, downcomers from it along the outer side.
void DrawDrum(Plant& plant, const Boiler& boiler, Budget budget) {
  const double all = static_cast<double>(budget.Room());
  const float x = boiler.Middle().x;
  plant.b.Part(fmt::format("boiler {} steam drum", boiler.index));
  plant.b.Use(kPolished);
  const int rows = std::clamp(static_cast<int>(all / 400), 2, 16);
  Vessel(plant.b, {x, 12.5f, kDrumZ}, {x, 27.5f, kDrumZ}, 1.3f, 0.9f, SegmentsFor(0.2 * all, 2 * rows, 64),
         rows);
  const int pipes = std::clamp(static_cast<int>(all / (1.5 * plant.item)), 2, 120);
  for (int i = 0; i < pipes && budget.Room() > 0; ++i) {
    Random random(plant.seed, 58, static_cast<uint64_t>(i), static_cast<uint64_t>(boiler.index));
    const double share = budget.Share(static_cast<uint64_t>(pipes - i));
    const float y = glm::mix(14.0f, 26.0f, (static_cast<float>(i) + 0.5f) / static_cast<float>(pipes));
    const float radius = std::min(0.22f, 4.0f / static_cast<float>(pipes));
    if (i % 3 == 0) {
      const float out = boiler.Side() > 0 ? boiler.high.x + 0.9f : boiler.low.x - 0.9f;
      const std::array<vec3, 5> points{vec3(x + 1.2f * boiler.Side(), y, kDrumZ), vec3(out, y, kDrumZ),
                                       vec3(out, y, 7.0f), vec3(x + 1.3f * boiler.Side(), y, 7.0f),
                                       vec3(x + 1.3f * boiler.Side(), y, kBottom - 0.5f)};
      plant.b.Part(fmt::format("boiler {} downcomer {}", boiler.index, i));
      DrawPipe(plant, points, radius, share, random);
    } else {
      const std::array<vec3, 2> points{vec3(x + random.Uniform(-0.7f, 0.7f), y, kTop + 0.25f),
                                       vec3(x, y, kDrumZ - 1.0f)};
      plant.b.Part(fmt::format("boiler {} riser {}", boiler.index, i));
      DrawPipe(plant, points, radius, share, random);
    }
  }
}

/// Burners on both ends of the casing: cones with a pipe each.
void DrawBurners(Plant& plant, const Boiler& boiler, Budget budget) {
  constexpr int kBurners = 16;
  for (int i = 0; i < kBurners; ++i) {
    const double share = budget.Share(static_cast<uint64_t>(kBurners - i));
    if (share < 60) return;
    const bool north = i % 2;
    const vec3 out(0, north ? 1.0f : -1.0f, 0);
    const vec3 at(boiler.Middle().x + (i / 2 % 2 ? 1.2f : -1.2f), north ? boiler.high.y : boiler.low.y,
                  14.3f + 3.17f * static_cast<float>(i / 4));
    const std::array<glm::vec2, 6> profile{glm::vec2{0.75f, -0.05f}, {0.75f, 0.25f}, {0.5f, 0.3f},
                                           glm::vec2{0.4f, 0.8f},    {0.12f, 0.9f},  {0, 0.9f}};
    plant.b.Part(fmt::format("boiler {} burner {}", boiler.index, i));
    plant.b.Use(i % 4 < 2 ? kCopper : kRedPaint);
    Lathe(plant.b, at, out, profile, SegmentsFor(share, 5, 64));
  }
}

/// From the tops of the boilers through the east wall to the chimney.
void DrawFlue(Plant& plant) {
  plant.b.Part("flue");
  plant.b.Use(kInsulation, vec3(0.8f));
  Box(plant.b, {25.0f, 18.5f, 75.0f}, {kSizeX + 0.32f, 21.5f, 77.5f});
  for (const Boiler& boiler : kBoilers) {
    const float x = boiler.Middle().x + 1.8f;
    Box(plant.b, {x - 0.4f, 18.6f, kTop + 0.3f}, {x + 0.4f, 21.4f, 75.0f});
  }
  plant.b.Part("flue outside");
  plant.b.Use(kGalvanised);
  Box(plant.b, {kSizeX + 0.33f, 18.2f, 8.0f}, {kSizeX + 4.0f, 21.8f, 78.0f});
  Box(plant.b, {kSizeX + 4.0f, 18.2f, 8.0f}, {77.6f, 21.8f, 12.0f});
  for (int i = 0; i < 3; ++i) {
    const float x = 57.0f + 7.0f * static_cast<float>(i);
    Box(plant.b, {x, 18.5f, 0}, {x + 0.6f, 21.5f, 8.0f});
  }
}

}  // namespace

void DrawBoilers(Plant& plant, Budget budget) {
  DrawFlue(plant);
  for (const Boiler& boiler : kBoilers) {
    const Budget half = budget.Next(budget.Share(static_cast<uint64_t>(2 - boiler.index)));
    if (half.Room() < 12) return;
    DrawHopper(plant, boiler);
    if (half.Room() >= 108) {
      DrawCasing(plant, boiler);
      DrawLegs(plant, boiler);
    } else {
      plant.b.Part(fmt::format("boiler {} casing", boiler.index));
      plant.b.Use(kInsulation);
      Box(plant.b, boiler.low, boiler.high);
    }
    const double room = static_cast<double>(half.Room());
    if (room < 800) continue;
    DrawDrum(plant, boiler, half.Next(0.1 * room));
    DrawBuckstays(plant, boiler, half.Next(0.05 * room));
    DrawBurners(plant, boiler, half.Next(0.05 * room));
    DrawTubeWalls(plant, boiler, half.Next(0.35 * room));
    DrawSuperheaters(plant, boiler, half);
  }
}

}  // namespace quarry::scenes

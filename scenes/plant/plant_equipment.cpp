#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec2;
using glm::vec3;

constexpr float kClear = 0.45f;    ///< From the edge of a bay to its equipment: columns, railings.
constexpr float kHeadroom = 7.9f;  ///< From floor to the floor above.

/// A bay to be filled.
struct Site {
  vec3 floor;  ///< The corner of least x and y.
  std::string name;
  uint64_t id;

  vec3 At(float u, float v, float z) const {
    const float side = kBay - 2 * kClear;
    return floor + vec3(kClear + side * u, kClear + side * v, z);
  }
};

std::string Label(const Site& site, const char* what, uint64_t index) {
  return fmt::format("{} {} in {}", what, index, site.name);
}

/// A field of vertical pipes between u0 and u1 from `low` to the ceiling, as many as the budget has.
void DrawBundle(Plant& plant, const Site& site, float u0, float u1, float low, Budget budget) {
  const double cost = 1.6 * plant.item;
  const auto count = static_cast<uint64_t>(static_cast<double>(budget.Room()) / cost);
  if (count == 0) return;
  const float side = kBay - 2 * kClear, wide = side * (u1 - u0);
  const float pitch = std::min(0.9f, std::sqrt(wide * side / static_cast<float>(count)));
  const auto columns = std::max<uint64_t>(1, static_cast<uint64_t>(wide / pitch));
  const uint64_t rows = (count + columns - 1) / columns;
  const float du = (u1 - u0) / static_cast<float>(columns), dv = 1.0f / static_cast<float>(rows);
  const float room = std::min(du, dv) * side;
  for (uint64_t i = 0; i < count && budget.Room() > 0; ++i) {
    Random random(plant.seed, 70, site.id, i);
    const float u = u0 + du * (static_cast<float>(i % columns) + 0.5f),
                v = dv * (static_cast<float>(i / columns) + 0.5f);
    const float radius = room * random.Uniform(0.08f, 0.26f);
    // The jog stays in the pipe's own cell of the grid.
    const vec3 jog(room * random.Uniform(-0.2f, 0.2f), room * random.Uniform(-0.2f, 0.2f), 0.5f * room);
    const vec3 foot = site.At(u, v, low), top = site.At(u, v, kHeadroom);
    const vec3 bend = glm::mix(foot, top, random.Uniform(0.2f, 0.7f));
    const std::array<vec3, 4> bent{foot, bend, bend + jog, vec3(bend.x + jog.x, bend.y + jog.y, top.z)};
    const std::array<vec3, 2> straight{foot, top};
    plant.b.Part(Label(site, "pipe", i));
    const double share = budget.Share(count - i) * random.Uniform(0.6f, 1.4f);
    if (share > 60 && random.Chance(0.6f)) {
      DrawPipe(plant, bent, radius, share, random);
    } else {
      DrawPipe(plant, straight, radius, share, random);
    }
  }
}

uint16_t TankMaterial(Random& random) {
  constexpr std::array<uint16_t, 7> kMaterials{kPolished,   kChrome,    kInsulation, kWhitePaint,
                                               kGreenPaint, kGreyPaint, kBluePaint};
  return kMaterials[random.Below(kMaterials.size())];
}

/// A vertical tank on legs with belts; pipes beside it.
void DrawTank(Plant& plant, const Site& site, Budget budget) {
  Random random(plant.seed, 71, site.id);
  const double share = std::min(0.35 * budget.Share(1), 60 * plant.item);
  const float radius = random.Uniform(1.0f, 1.35f), height = random.Uniform(3.5f, 6.2f);
  const vec3 foot = site.At(0.34f, 0.5f, 0.7f);
  plant.b.Part(Label(site, "tank", 0));
  plant.b.Use(TankMaterial(random), Worn(random));
  const int rows = std::clamp(static_cast<int>(std::sqrt(share) / 8), 2, 24);
  const int segments = SegmentsFor(0.6 * share, 2 * rows, 128);
  Vessel(plant.b, foot, foot + vec3(0, 0, height), radius, 0.45f * radius, segments, rows);
  plant.b.Use(kSteel, Worn(random));
  for (int i = 0; i < 4 && share > 100; ++i) {
    const vec3 leg = foot + vec3(i & 1 ? 0.6f : -0.6f, i & 2 ? 0.6f : -0.6f, 0) * radius;
    Beam(plant.b, leg - vec3(0, 0, 0.7f), leg + vec3(0, 0, 0.4f), 0.14f, 0.14f);
  }
  for (int i = 0; i < 4 && share > 400; ++i)
    Torus(plant.b, foot + vec3(0, 0, height * (0.25f + 0.17f * static_cast<float>(i))), {0, 0, 1}, radius,
          0.03f, std::min(segments, 48), 4);
  DrawBundle(plant, site, 0.68f, 1.0f, 0.0f, budget);
}

/// Shells on saddles one above the other, with the tubes inside them.
void DrawExchangers(Plant& plant, const Site& site, Budget budget) {
  constexpr int kShells = 3;
  for (int i = 0; i < kShells; ++i) {
    const Budget share = budget.Next(0.8 * budget.Share(static_cast<uint64_t>(kShells - i)));
    const double all = static_cast<double>(share.Room());
    Random random(plant.seed, 72, site.id, static_cast<uint64_t>(i));
    const float radius = random.Uniform(0.55f, 0.8f);
    const vec3 from = site.At(0.25f, 0.04f, 1.2f + 2.1f * static_cast<float>(i)),
               to = site.At(0.25f, 0.96f, from.z - site.floor.z);
    plant.b.Part(Label(site, "heat exchanger", static_cast<uint64_t>(i)));
    plant.b.Use(TankMaterial(random), Worn(random));
    const int rows = std::clamp(static_cast<int>(std::sqrt(all) / 12), 2, 16);
    Vessel(plant.b, from, to, radius, 0.4f * radius, SegmentsFor(0.25 * all, 2 * rows, 96), rows);
    plant.b.Use(kConcrete);
    for (float where : {0.2f, 0.8f}) {
      const vec3 at = glm::mix(from, to, where);
      Box(plant.b, at - vec3(0.5f, 0.12f, i == 0 ? 1.2f : 2.1f - radius),
          at - vec3(-0.5f, -0.12f, 0.93f * radius));
    }
    const double cost = plant.item;
    const auto tubes = static_cast<uint64_t>(static_cast<double>(share.Room()) / cost);
    for (uint64_t k = 0; k < tubes && share.Room() > 0; ++k) {
      // A sunflower: any number of tubes, evenly over the disc.
      const float r = 0.85f * radius * std::sqrt((static_cast<float>(k) + 0.5f) / static_cast<float>(tubes));
      const float angle = 2.39996f * static_cast<float>(k);
      const vec3 off(r * std::cos(angle), 0.6f, r * std::sin(angle));
      const std::array<vec3, 2> points{from + off, to + off * vec3(1, -1, 1)};
      TubeStyle style{.radius = std::min(0.06f, 0.6f * radius / std::sqrt(static_cast<float>(tubes))),
                      .segments = std::clamp(static_cast<int>(cost / 16), 3, 20)};
      style.leg_steps = std::clamp(static_cast<int>(cost / style.segments / 2) - 1, 1, 40);
      plant.b.Part(fmt::format("exchanger tube {} of shell {} in {}", k, i, site.name));
      plant.b.Use(kCopper, Worn(random));
      Tube(plant.b, points, style);
    }
  }
  DrawBundle(plant, site, 0.58f, 1.0f, 0.0f, budget);
}

/// One pump on its plinth with a finned motor, and a pipe up.
void DrawPump(Plant& plant, const Site& site, uint64_t index, const vec3& at, Budget budget) {
  Builder& b = plant.b;
  Random random(plant.seed, 73, site.id, index);
  const double all = static_cast<double>(budget.Room());
  const int segments = std::clamp(static_cast<int>(std::sqrt(all) / 2.5), 4, 48);
  const vec3 axis(0, 1, 0);
  b.Part(Label(site, "pump", index));
  b.Use(kConcrete);
  Box(b, at - vec3(0.35f, 0.8f, 0), at + vec3(0.35f, 0.8f, 0.25f));
  b.Use(kBluePaint, Worn(random));
  const vec3 shaft = at + vec3(0, 0, 0.6f);
  const std::array<vec2, 8> body{vec2{0, -0.7f},     {0.2f, -0.7f}, {0.3f, -0.5f},  {0.3f, -0.3f},
                                 vec2{0.12f, -0.2f}, {0.1f, 0.05f}, {0.05f, 0.05f}, {0, 0.05f}};
  Lathe(b, shaft, axis, body, segments);
  b.Use(kGreenPaint, Worn(random));
  Cylinder(b, shaft + vec3(0, 0.06f, 0), shaft + vec3(0, 0.68f, 0), 0.24f, segments);
  const int fins = std::clamp(static_cast<int>(0.25 * all / 12), 0, 40);
  for (int i = 0; i < fins; ++i) {
    const float angle = 2 * kPi * static_cast<float>(i) / static_cast<float>(fins);
    const vec3 out(std::cos(angle), 0, std::sin(angle));
    OrientedBox(b, shaft + vec3(0, 0.37f, 0) + 0.26f * out, 0.035f * out, {0, 0.25f, 0},
                0.006f * glm::cross(out, axis));
  }
  const vec3 outlet = shaft + vec3(0, -0.4f, 0.25f);
  const std::array<vec3, 4> pipe{outlet, outlet + vec3(0, 0, 0.9f), outlet + vec3(0.28f, 0, 0.9f),
                                 vec3(outlet.x + 0.28f, outlet.y, site.floor.z + kHeadroom)};
  if (budget.Room() > 40) DrawPipe(plant, pipe, 0.09f, static_cast<double>(budget.Room()), random);
}

void DrawPumps(Plant& plant, const Site& site, Budget budget) {
  const int count = std::clamp(static_cast<int>(budget.Share(1) / (12 * plant.item)), 1, 8);
  for (int i = 0; i < count; ++i) {
    const Budget share = budget.Next(0.6 * budget.Share(static_cast<uint64_t>(count - i)));
    const vec3 at = site.At(0.12f + 0.25f * static_cast<float>(i % 4), i < 4 ? 0.2f : 0.75f, 0);
    if (share.Room() > 120) DrawPump(plant, site, static_cast<uint64_t>(i), at, share);
  }
  // Above the pumps; a pump's own pipe passes in the gap at the wall.
  DrawBundle(plant, site, 0.0f, 1.0f, 2.6f, budget);
}

/// Rows of electrical cabinets with handles and lamps, conduits to the ceiling.
void DrawCabinets(Plant& plant, const Site& site, Budget budget) {
  const int count = std::clamp(static_cast<int>(budget.Share(1) / (4 * plant.item)), 1, 10);
  for (int i = 0; i < count; ++i) {
    const Budget share = budget.Next(0.5 * budget.Share(static_cast<uint64_t>(count - i)));
    Random random(plant.seed, 74, site.id, static_cast<uint64_t>(i));
    const vec3 at = site.At(i < 5 ? 0.1f : 0.75f, 0.02f + 0.19f * static_cast<float>(i % 5), 0);
    const float high = random.Uniform(1.8f, 2.3f);
    plant.b.Part(Label(site, "cabinet", static_cast<uint64_t>(i)));
    plant.b.Use(kGreyPaint, Worn(random));
    Box(plant.b, at, at + vec3(0.6f, 0.72f, high));
    const auto knobs = static_cast<int>(0.4 * static_cast<double>(share.Room()) / kBoltTriangles);
    const int across = std::max(1, static_cast<int>(std::sqrt(static_cast<float>(knobs) * 0.4f)));
    const float cell = 0.6f / static_cast<float>(across);
    for (int k = 0; k < knobs; ++k) {
      plant.b.Use(random.Chance(0.3f) ? kRedPaint : (random.Chance(0.5f) ? kGreenPaint : kChrome));
      const vec3 knob = at + vec3(0.6f, 0.06f + cell * (static_cast<float>(k % across) + 0.5f),
                                  high - 0.1f - cell * static_cast<float>(k / across));
      if (knob.z > at.z + 0.1f)
        Bolt(plant.b, knob, {1, 0, 0}, 0.35f * cell < 0.04f ? 0.35f * cell : 0.04f, 0.02f);
    }
    const std::array<vec3, 2> conduit{at + vec3(0.3f, 0.36f, high),
                                      vec3(at.x + 0.3f, at.y + 0.36f, site.floor.z + kHeadroom)};
    if (share.Room() > 20) DrawPipe(plant, conduit, 0.06f, static_cast<double>(share.Room()), random);
  }
  DrawBundle(plant, site, 0.36f, 0.66f, 0.0f, budget);
}

void DrawSite(Plant& plant, const Site& site, Budget budget) {
  Random random(plant.seed, 75, site.id);
  const float kind = random.Uniform();
  if (budget.Share(1) < 400 || kind < 0.3f) return DrawBundle(plant, site, 0.0f, 1.0f, 0.0f, budget);
  if (kind < 0.52f) return DrawTank(plant, site, budget);
  if (kind < 0.72f) return DrawExchangers(plant, site, budget);
  if (kind < 0.88f) return DrawPumps(plant, site, budget);
  DrawCabinets(plant, site, budget);
}

}  // namespace

void DrawEquipment(Plant& plant, Budget budget) {
  // Small plants fill only some bays, the bays of the lower levels first.
  const auto affordable = static_cast<int>(budget.Share(1) / (5 * plant.item));
  int sites = 0, done = 0;
  for (int pass = 0; pass < 2; ++pass)
    for (int level = 0; level < kLevels; ++level)
      for (int y = 0; y < kBaysY; ++y)
        for (int x = 0; x < kBaysX; ++x) {
          if (!InEquipment(x, y, level)) continue;
          if (pass == 0) {
            ++sites;
            continue;
          }
          const int left = std::min(sites, affordable) - done;
          if (left <= 0) return;
          ++done;
          const Site site{{kBay * static_cast<float>(x), kBay * static_cast<float>(y),
                           kLevel * static_cast<float>(level) + (level == 0 ? 0.02f : 0.0f)},
                          fmt::format("bay {},{} of level {}", x, y, level),
                          static_cast<uint64_t>(level * 100 + y * 10 + x)};
          Random random(plant.seed, 76, site.id);
          const double share =
              budget.Share(static_cast<uint64_t>(left)) * (left > 1 ? random.Uniform(0.5f, 1.5f) : 1.0f);
          DrawSite(plant, site, budget.Next(share));
        }
}

}  // namespace quarry::scenes

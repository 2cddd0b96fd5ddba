#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

/// A space over the walkway that runs along `along`; lanes lie beside each other across it, tiers above each
/// other. Racks along x hang below those along y, so that they cross without meeting.
struct Rack {
  const char* name;
  vec3 corner, along, across;  ///< Relative to the floor of its level.
  float length, width, height;
};

constexpr std::array<Rack, 4> kRacks{
    {{"south", {10.6f, 6.1f, 2.9f}, {1, 0, 0}, {0, 1, 0}, 28.8f, 2.8f, 1.9f},
     {"north", {10.6f, 31.1f, 2.9f}, {1, 0, 0}, {0, 1, 0}, 28.8f, 2.8f, 1.9f},
     {"west", {11.1f, 5.6f, 5.2f}, {0, 1, 0}, {1, 0, 0}, 28.8f, 2.8f, 1.9f},
     {"east", {36.1f, 5.6f, 5.2f}, {0, 1, 0}, {1, 0, 0}, 28.8f, 2.8f, 1.9f}}};

/// One slot of a rack: its middle line and how much room there is around it.
struct Slot {
  vec3 from, to;
  float pitch;
};

/// Cables side by side in a tray of two sides and rungs.
void DrawCableTray(Plant& plant, const Rack& rack, const Slot& slot, double triangles, Random& random) {
  Builder& b = plant.b;
  const float half = 0.42f * slot.pitch;
  const vec3 side = rack.across * half, up(0, 0, half);
  b.Use(kGalvanised, Worn(random));
  Beam(b, slot.from - side, slot.to - side, 0.12f * half, 0.6f * half);
  Beam(b, slot.from + side, slot.to + side, 0.12f * half, 0.6f * half);
  const int rungs = std::clamp(static_cast<int>(0.3 * triangles / 12), 2, 120);
  for (int i = 0; i < rungs; ++i) {
    const vec3 at =
        glm::mix(slot.from, slot.to, (static_cast<float>(i) + 0.5f) / static_cast<float>(rungs)) - 0.2f * up;
    OrientedBox(b, at, side * 0.93f, rack.along * 0.02f,
                vec3(0, 0, 0.05f * half) * (rack.along.x > 0 ? -1.0f : 1.0f));
  }
  const int cables = std::clamp(static_cast<int>(0.6 * triangles / 100), 1, 9);
  for (int i = 0; i < cables; ++i) {
    const float radius = 0.8f * half / static_cast<float>(cables),
                where = (2.0f * static_cast<float>(i) + 1.0f) / static_cast<float>(cables) - 1.0f;
    std::array<vec3, 5> points;
    for (size_t k = 0; k < points.size(); ++k)
      points[k] = glm::mix(slot.from, slot.to, static_cast<float>(k) / 4.0f) + side * (0.85f * where) +
                  rack.across * random.Uniform(-0.1f, 0.1f) * radius + vec3(0, 0, radius - 0.1f * half);
    TubeStyle style{.radius = 0.8f * radius, .bend_radius = 2 * radius, .segments = 3, .bend_steps = 1};
    style.segments = std::clamp(static_cast<int>(0.6 * triangles / cables / 16), 3, 16);
    b.Use(random.Chance(0.3f) ? kRedPaint : kRubber, Worn(random));
    Tube(b, points, style);
  }
}

/// A pipe that comes up or down at each end and may step aside within its slot on the way.
void DrawRackPipe(Plant& plant, const Rack& rack, const Slot& slot, bool ends_up, double triangles,
                  Random& random) {
  const float radius = slot.pitch * random.Uniform(0.12f, 0.3f);
  const vec3 jog = rack.across * (slot.pitch * random.Uniform(-0.12f, 0.12f));
  const vec3 rise(0, 0, (ends_up ? 1.0f : -1.0f) * slot.pitch * 0.45f);
  const float near = random.Uniform(0.02f, 0.2f), far = random.Uniform(0.8f, 0.98f),
              middle = random.Uniform(0.35f, 0.65f);
  const vec3 a = glm::mix(slot.from, slot.to, near), z = glm::mix(slot.from, slot.to, far);
  const vec3 m = glm::mix(slot.from, slot.to, middle);
  const std::array<vec3, 6> points{
      a + rise, a, m, m + jog + rack.along * (2.5f * std::abs(slot.pitch) * 0.4f), z + jog, z + jog + rise};
  const bool bent = triangles > 60;
  DrawPipe(plant, bent ? std::span<const vec3>(points) : std::span<const vec3>(points).subspan(1, 2), radius,
           triangles, random);
}

/// Trapezes that carry the rack: posts to the floor above and a beam below each tier.
void DrawHangers(Plant& plant, const Rack& rack, const vec3& floor, int tiers, int level, Budget budget) {
  const int per_hanger = 12 * (2 + tiers),
            hangers = std::min(12, static_cast<int>(budget.Room()) / per_hanger);
  for (int i = 0; i < hangers; ++i) {
    const vec3 at = floor + rack.corner +
                    rack.along * (rack.length * (static_cast<float>(i) + 0.5f) / static_cast<float>(hangers));
    const vec3 across = rack.across * rack.width;
    const float roof = kLevel - 0.1f - rack.corner.z;
    plant.b.Part(fmt::format("hanger {} of {} rack, level {}", i, rack.name, level));
    plant.b.Use(kGalvanised, vec3(0.85f));
    Beam(plant.b, at, at + vec3(0, 0, roof), 0.07f, 0.07f);
    Beam(plant.b, at + across, at + across + vec3(0, 0, roof), 0.07f, 0.07f);
    for (int tier = 0; tier < tiers; ++tier) {
      const vec3 lift(0, 0, rack.height * static_cast<float>(tier) / static_cast<float>(tiers));
      Beam(plant.b, at + lift, at + across + lift, 0.05f, 0.05f);
    }
  }
}

void DrawRack(Plant& plant, const Rack& rack, int level, Budget budget) {
  const vec3 floor(0, 0, kLevel * static_cast<float>(level));
  const double cost = 2.2 * plant.item;
  const auto slots = static_cast<uint64_t>(0.94 * static_cast<double>(budget.Room()) / cost);
  if (slots == 0) return;
  const float pitch = std::min(0.9f, std::sqrt(rack.width * rack.height / static_cast<float>(slots)));
  const auto lanes = std::max<uint64_t>(1, static_cast<uint64_t>(rack.width / pitch));
  const auto tiers = (slots + lanes - 1) / lanes;
  const float wide = rack.width / static_cast<float>(lanes), high = rack.height / static_cast<float>(tiers);
  if (plant.triangles >= 100000)
    DrawHangers(plant, rack, floor, static_cast<int>(std::min<uint64_t>(tiers, 4)), level,
                budget.Next(0.05 * static_cast<double>(budget.Room())));
  for (uint64_t i = 0; i < slots && budget.Room() > 0; ++i) {
    Random random(plant.seed, 90 + static_cast<uint64_t>(level), i, static_cast<uint64_t>(rack.name[0]));
    const uint64_t lane = i % lanes, tier = i / lanes;
    const vec3 start = floor + rack.corner + rack.across * (wide * (static_cast<float>(lane) + 0.5f)) +
                       vec3(0, 0, high * (static_cast<float>(tier) + 0.5f));
    const Slot slot{start, start + rack.along * rack.length, std::min(wide, high)};
    const double share = budget.Share(slots - i);
    const bool tray = plant.triangles > 50000 && random.Chance(0.2f);
    plant.b.Part(
        fmt::format("{} {} of {} rack, level {}", tray ? "cable tray" : "pipe", i, rack.name, level));
    if (tray) {
      DrawCableTray(plant, rack, slot, share, random);
    } else {
      DrawRackPipe(plant, rack, slot, tier + 1 == tiers, share * random.Uniform(0.6f, 1.4f), random);
    }
  }
}

}  // namespace

void DrawRacks(Plant& plant, Budget budget) {
  // The top level stays free for the flue. A small plant has racks where they are seen first.
  const int levels = plant.triangles < 20000 ? 3 : kLevels - 1;
  for (int level = 0; level < levels; ++level)
    for (size_t i = 0; i < kRacks.size(); ++i) {
      const uint64_t left = kRacks.size() * static_cast<uint64_t>(levels - level) - i;
      DrawRack(plant, kRacks[i], level, budget.Next(budget.Share(left)));
    }
}

}  // namespace quarry::scenes

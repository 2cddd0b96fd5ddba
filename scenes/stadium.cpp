#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/random.h"
#include "scenes/scene.h"
#include "scenes/shapes.h"
#include "scenes/surface.h"

// A teapot in a stadium: a large scene of few triangles around a small object of many, which no uniform grid
// fits. The teapot takes about a thousandth of the stadium's length and nearly all of its triangles.

namespace quarry::scenes {
namespace {

using glm::vec2;
using glm::vec3;

enum StadiumMaterial : uint16_t {
  kGrass,
  kTrack,
  kLine,
  kConcrete,
  kSeatRed,
  kSeatBlue,
  kSeatGold,
  kRoofing,
  kSteel,
  kFloodlight,
  kMarble,
  kPorcelain,
  kGlaze,
  kGilt,
  kStadiumMaterials
};

constexpr float kPitchLength = 105, kPitchWidth = 68;
constexpr float kStandDepth = 36, kFrontWall = 2, kStandHeight = 24, kWallHeight = 31;
constexpr float kTableHeight = 0.78f;
/// Fewer triangles than this leave out seats, roof, goals and floodlights.
constexpr uint64_t kFewestForAll = 6000;
/// Triangles of the stands beyond which only the teapot becomes finer.
constexpr double kMostStandTriangles = 50000;

/// The point at `angle` of the oval `out` metres outside of the stands' front. A superellipse of exponent 4.
vec3 Oval(float angle, float out, float z) {
  const float c = std::cos(angle), s = std::sin(angle);
  const float scale = std::sqrt(std::sqrt(1.0f / (c * c * c * c + s * s * s * s)));
  return {(62 + out) * c * scale, (44 + out) * s * scale, z};
}

// The teapot's own coordinates: metres, z = 0 at its foot, the spout towards +x. u goes around, from 0 to 2
// pi; v goes along, from 0 to 1.

vec3 Turned(float radius, float z, float u) { return {radius * std::cos(u), radius * std::sin(u), z}; }

/// The belly widens along a quarter of a sine to 38 % of the height, and narrows along a cosine above.
vec3 Body(float u, float v) {
  const float radius = v < 0.38f ? 0.064f + 0.036f * std::sin(0.5f * kPi * v / 0.38f)
                                 : 0.066f + 0.034f * std::cos(0.5f * kPi * (v - 0.38f) / 0.62f);
  return Turned(radius, 0.004f + 0.126f * v, u);
}

/// A flat dome that overhangs the body's rim a little.
vec3 Lid(float u, float v) {
  const float angle = 0.46f * kPi * v;
  return Turned(0.070f * std::cos(angle), 0.128f + 0.030f * std::sin(angle), u);
}

/// A waist below a ball.
vec3 Knob(float u, float v) {
  const float angle = kPi * (-0.36f + 0.84f * v);
  const float waist = std::exp(-16 * v * v);
  return Turned(0.0155f * std::cos(angle) + 0.004f * waist, 0.170f + 0.0155f * std::sin(angle), u);
}

/// The ring around `center` across `tangent`, which lies in the plane of x and z.
vec3 Swept(const vec3& center, const vec3& tangent, float radius, float flat, float u) {
  const vec3 along = glm::normalize(tangent), normal(-along.z, 0, along.x);
  return center + radius * (std::cos(u) * normal + flat * std::sin(u) * glm::cross(along, normal));
}

/// Rises in an S out of the belly; from v = 0.75 on its inner wall goes back down from the lip.
vec3 Spout(float u, float v) {
  const float s = v < 0.75f ? v / 0.75f : 1 - 0.5f * (v - 0.75f) / 0.25f;
  const float rise = s * s * (3 - 2 * s);
  const vec3 center(0.072f + 0.118f * s, 0, 0.038f + 0.094f * rise);
  const vec3 tangent(0.118f, 0, 0.094f * 6 * s * (1 - s) + 0.03f);
  const float outer = 0.029f - 0.021f * std::sqrt(s) + 0.005f * s * s * s * s;
  return Swept(center, tangent, v < 0.75f ? outer : 0.8f * outer, 0.85f, u);
}

/// An ear whose ends are inside of the body.
vec3 Handle(float u, float v) {
  const float angle = kPi * (0.02f + 0.96f * v);
  const vec3 center(-0.066f - 0.092f * std::sin(angle), 0, 0.074f + 0.044f * std::cos(angle));
  const vec3 tangent(-0.092f * std::cos(angle), 0, -0.044f * std::sin(angle));
  return Swept(center, tangent, 0.0075f + 0.002f * std::cos(angle), 1.35f, u);
}

class Stadium : public Scene {
 public:
  explicit Stadium(const SceneOptions& options)
      : options_(options), complete_(options.triangles >= kFewestForAll) {
    // A tier's place in the round: four triangles, and a bench of twelve on seven places of eight.
    const double stands = std::min(0.3 * static_cast<double>(options.triangles), kMostStandTriangles);
    const double places = stands / (complete_ ? 14.5 : 4);
    tiers_ = std::clamp(static_cast<int>(std::sqrt(places / 7)), 3, 22);
    columns_ = std::clamp(static_cast<int>(places / tiers_) / 8 * 8, complete_ ? 32 : 12, 160);
  }

  std::vector<Material> Materials() const override {
    std::vector<Material> m(kStadiumMaterials);
    const auto set = [&](StadiumMaterial i, const char* name, const vec3& diffuse) {
      m[i].name = name;
      m[i].diffuse = diffuse;
    };
    const auto shine = [&](StadiumMaterial i, const vec3& reflectance, float shininess) {
      m[i].reflectance = m[i].specular = reflectance;
      m[i].shininess = shininess;
    };
    set(kGrass, "grass", {0.16f, 0.40f, 0.10f});
    set(kTrack, "track", {0.48f, 0.19f, 0.12f});
    set(kLine, "line", vec3(0.85f));
    set(kConcrete, "concrete", vec3(0.52f, 0.51f, 0.49f));
    set(kSeatRed, "red seat", {0.62f, 0.07f, 0.08f});
    set(kSeatBlue, "blue seat", {0.07f, 0.16f, 0.52f});
    set(kSeatGold, "gold seat", {0.80f, 0.56f, 0.09f});
    set(kRoofing, "roofing", {0.72f, 0.76f, 0.80f});
    set(kSteel, "steel", vec3(0.45f));
    set(kFloodlight, "floodlight", vec3(0.8f));
    m[kFloodlight].emission = vec3(6.0f, 5.8f, 5.2f);
    set(kMarble, "marble", {0.74f, 0.71f, 0.67f});
    set(kPorcelain, "porcelain", vec3(0.86f, 0.85f, 0.82f));
    shine(kPorcelain, vec3(0.06f), 300);
    set(kGlaze, "blue glaze", {0.06f, 0.14f, 0.42f});
    shine(kGlaze, vec3(0.10f), 500);
    set(kGilt, "gilt", {0.55f, 0.38f, 0.10f});
    shine(kGilt, {0.40f, 0.30f, 0.10f}, 200);
    return m;
  }

  void Draw(Builder& b) const override {
    DrawPitch(b);
    DrawStands(b);
    if (complete_) {
      DrawSeats(b);
      DrawGoals(b);
      DrawFloodlights(b);
    }
    DrawTable(b);
    DrawTeapot(b);
    DrawPinnacles(b);
  }

  std::vector<CameraFrame> Path() const override {
    const vec3 teapot(0.01f, 0, kTableHeight + 0.09f);
    const std::array<CameraKey, 5> keys{{{{0.16f, -0.40f, kTableHeight + 0.17f}, teapot + vec3(0, 0, 0.03f)},
                                         {{0.9f, -1.6f, kTableHeight + 0.5f}, teapot},
                                         {{16, -22, 6}, teapot + vec3(0, 0, 4)},
                                         {{48, -34, 20}, {-10, 5, 3}},
                                         {{150, -130, 95}, {0, 0, 0}}}};
    return WalkAlong(keys, 60, 60);
  }

 private:
  static void DrawPitch(Builder& b) {
    constexpr int kStripes = 12;
    constexpr float kStripe = kPitchLength / kStripes, kX = 0.5f * kPitchLength, kY = 0.5f * kPitchWidth;
    b.Part("ground");
    b.Use(kTrack);
    Sheet(b, {-180, -160, -0.03f}, {360, 0, 0}, {0, 320, 0});
    b.Part("pitch");
    for (int i = 0; i < kStripes; ++i) {
      b.Use(kGrass, i % 2 ? vec3(1.0f) : vec3(0.72f, 0.80f, 0.72f));
      Sheet(b, {-kX + kStripe * static_cast<float>(i), -kY, 0}, {kStripe, 0, 0}, {0, kPitchWidth, 0});
    }
    b.Part("lines");
    b.Use(kLine);
    constexpr float kWide = 0.12f, kHigh = 0.01f;
    for (const float x : {-kX, -0.5f * kWide, kX - kWide})
      Sheet(b, {x, -kY, kHigh}, {kWide, 0, 0}, {0, kPitchWidth, 0});
    for (const float y : {-kY, kY - kWide})
      Sheet(b, {-kX + kWide, y, 2 * kHigh}, {kPitchLength - 2 * kWide, 0, 0}, {0, kWide, 0});
    const std::array<vec2, 2> circle{vec2{9.15f + kWide, 2 * kHigh}, {9.15f, 2 * kHigh}};
    Lathe(b, {0, 0, 0}, {0, 0, 1}, circle, 32);
  }

  /// A ring about the pitch: `profile` (x: metres outside of the front, y: height) seen from its left.
  void DrawRing(Builder& b, std::span<const vec2> profile) const {
    b.BeginShape();
    const auto columns = static_cast<uint32_t>(columns_);
    uint32_t first = 0;
    for (size_t j = 0; j < profile.size(); ++j)
      for (uint32_t i = 0; i < columns; ++i) {
        const uint32_t v = b.Vertex(Oval(Angle(static_cast<float>(i)), profile[j].x, profile[j].y));
        if (i == 0 && j == 0) first = v;
      }
    for (uint32_t j = 0; j + 1 < profile.size(); ++j)
      for (uint32_t i = 0; i < columns; ++i) {
        const uint32_t v = first + j * columns + i, next = first + j * columns + (i + 1) % columns;
        b.Quad(v, next, next + columns, v + columns);
      }
  }

  float Angle(float column) const { return 2 * kPi * column / static_cast<float>(columns_); }
  float TierOut(int tier) const {
    return kStandDepth * static_cast<float>(tier) / static_cast<float>(tiers_);
  }
  /// The upper tiers are steeper.
  float TierHeight(int tier) const {
    const float t = static_cast<float>(tier) / static_cast<float>(tiers_);
    return kFrontWall + (kStandHeight - kFrontWall) * std::pow(t, 1.3f);
  }

  void DrawStands(Builder& b) const {
    b.Part("tiers");
    b.Use(kConcrete);
    std::vector<vec2> profile{{kStandDepth + 7, -0.03f},
                              {kStandDepth + 6, kWallHeight},
                              {kStandDepth + 5, kWallHeight},
                              {kStandDepth + 5, TierHeight(tiers_)}};
    for (int tier = tiers_ - 1; tier >= 0; --tier) {
      profile.push_back({TierOut(tier), TierHeight(tier + 1)});
      if (tier > 0) profile.push_back({TierOut(tier), TierHeight(tier)});
    }
    profile.push_back({0, -0.03f});
    DrawRing(b, profile);
    if (!complete_) return;
    b.Part("roof");
    b.Use(kRoofing);
    constexpr float kOut = kStandDepth + 8, kIn = 13;
    const std::array<vec2, 5> roof{vec2{kOut, kWallHeight + 0.4f},
                                   {kIn, kWallHeight - 1},
                                   {kIn, kWallHeight - 1.6f},
                                   {kOut, kWallHeight},
                                   {kOut, kWallHeight + 0.4f}};
    DrawRing(b, roof);
  }

  /// A bench for each place; each eighth column is an aisle.
  void DrawSeats(Builder& b) const {
    const float depth = TierOut(1);
    for (int tier = 0; tier < tiers_; ++tier) {
      b.Part(fmt::format("seats of tier {}", tier));
      Random random(options_.seed, 1, static_cast<uint64_t>(tier));
      const float out = TierOut(tier) + 0.65f * depth, z = TierHeight(tier + 1) + 0.24f;
      for (int column = 0; column < columns_; ++column) {
        const uint32_t block = static_cast<uint32_t>(column / 8 + tier / 8);
        const uint32_t other = random.Chance(0.12f) ? random.Below(3) : block;
        const vec3 tint(random.Uniform(0.7f, 1.0f));
        if (column % 8 == 7) continue;
        b.Use(static_cast<uint16_t>(kSeatRed + other % 3), tint);
        const float at = static_cast<float>(column);
        const vec3 from = Oval(Angle(at + 0.06f), out, z), to = Oval(Angle(at + 0.94f), out, z);
        const vec3 half = 0.5f * (to - from), in = glm::normalize(glm::cross(vec3(0, 0, 1), half));
        OrientedBox(b, 0.5f * (from + to), half, 0.16f * depth * in, {0, 0, 0.25f});
      }
    }
  }

  static void DrawGoals(Builder& b) {
    for (const float side : {-1.0f, 1.0f}) {
      b.Part(side < 0 ? "west goal" : "east goal");
      b.Use(kLine);
      const float x = side * 0.5f * kPitchLength;
      for (const float y : {-3.72f, 3.72f}) Beam(b, {x, y, 0}, {x, y, 2.5f}, 0.12f, 0.12f);
      Beam(b, {x, -3.78f, 2.56f}, {x, 3.78f, 2.56f}, 0.12f, 0.12f);
    }
  }

  static void DrawFloodlights(Builder& b) {
    for (int i = 0; i < 4; ++i) {
      b.Part(fmt::format("floodlight {}", i));
      const vec3 foot = Oval(kPi * (0.25f + 0.5f * static_cast<float>(i)), kStandDepth + 16, -0.03f);
      const vec3 top = foot + vec3(0, 0, 54);
      b.Use(kSteel);
      Cylinder(b, foot, top, 0.8f, 10);
      const vec3 ahead = glm::normalize(vec3(0, 0, 10) - top),
                 aside = glm::normalize(vec3(-foot.y, foot.x, 0));
      b.Use(kFloodlight);
      OrientedBox(b, top + ahead, aside * 5.0f, glm::cross(ahead, aside) * 2.5f, ahead * 0.4f);
    }
  }

  void DrawTable(Builder& b) const {
    b.Part("table");
    b.Use(kMarble);
    const std::array<vec2, 8> profile{vec2{0, 0},
                                      {0.26f, 0},
                                      {0.24f, 0.04f},
                                      {0.06f, 0.09f},
                                      {0.06f, kTableHeight - 0.08f},
                                      {0.33f, kTableHeight - 0.04f},
                                      {0.34f, kTableHeight},
                                      {0, kTableHeight}};
    Lathe(b, {0, 0, 0}, {0, 0, 1}, profile, complete_ ? 64 : 8);
  }

  /// A grid over `surface` with about the given share of the triangles that are left; `proportion`: length
  /// around over length along.
  template <typename Surface, typename Tint>
  static void DrawSurface(Builder& b, const char* name, uint16_t material, double triangles,
                          double proportion, const Surface& surface, const Tint& tint) {
    const GridSize grid = FitGrid(triangles, proportion);
    TiledSurface(
        b, name, grid.columns, grid.rows,
        [&](uint64_t i, uint64_t j) {
          // The last column is the first one, to the bit.
          const double u = 2 * static_cast<double>(kPi) * static_cast<double>(i % grid.columns) /
                           static_cast<double>(grid.columns);
          const double v = static_cast<double>(j) / static_cast<double>(grid.rows);
          return surface(static_cast<float>(u), static_cast<float>(v)) + vec3(0, 0, kTableHeight);
        },
        [&](uint64_t i, uint64_t j) {
          b.Use(material, tint(2 * kPi * static_cast<float>(i) / static_cast<float>(grid.columns),
                               static_cast<float>(j) / static_cast<float>(grid.rows)));
        });
  }

  void DrawTeapot(Builder& b) const {
    Random random(options_.seed, 2);
    const float petals = static_cast<float>(6 + random.Below(7)), turn = random.Uniform(0, 2 * kPi);
    const auto plain = [](float, float) { return vec3(1.0f); };
    // A garland between two lines.
    const auto painted = [&](float u, float v) {
      const vec3 blue(0.10f, 0.20f, 0.62f);
      if (std::abs(v - 0.62f) < 0.012f || std::abs(v - 0.16f) < 0.012f) return blue;
      const float wave = 0.39f + 0.13f * std::sin(petals * u + turn);
      const float leaf = 0.05f * (1 + 0.8f * std::sin(4 * petals * u));
      return std::abs(v - wave) < leaf ? blue : vec3(1.0f);
    };
    // The fans that close the foot and the knob's tip, and shares of the rest by area and by roundness.
    const int fan = complete_ ? 32 : 8;
    b.Part("teapot's foot");
    b.Use(kGilt);
    const std::array<vec2, 4> foot{vec2{0, 0.001f}, {0.058f, 0.001f}, {0.066f, 0.006f}, {0, 0.006f}};
    Lathe(b, {0, 0, kTableHeight}, {0, 0, 1}, foot, fan);
    b.Part("teapot's tip");
    Sphere(b, {0, 0, kTableHeight + 0.1853f}, 0.0016f, 6, 4);
    const double all = static_cast<double>(Budget(b, options_.triangles).Room());
    DrawSurface(b, "teapot's body", kPorcelain, 0.48 * all, 3.5, Body, painted);
    DrawSurface(b, "teapot's lid", kGlaze, 0.14 * all, 4.0, Lid, plain);
    DrawSurface(b, "teapot's knob", kGilt, 0.06 * all, 1.6, Knob, plain);
    DrawSurface(b, "teapot's spout", kPorcelain, 0.18 * all, 0.6, Spout, plain);
    DrawSurface(b, "teapot's handle", kGlaze, 0.14 * all, 0.25, Handle, plain);
  }

  /// On the outer wall, as many as are left to draw.
  void DrawPinnacles(Builder& b) const {
    const Budget budget(b, options_.triangles);
    b.Part("pinnacles");
    b.Use(kGilt);
    constexpr float kGolden = 2.39996323f;
    for (int i = 0; budget.Room() > 0; ++i)
      Spike(b, Oval(kGolden * static_cast<float>(i), kStandDepth + 5.5f, kWallHeight), 0.4f, 3.5f,
            static_cast<int>(std::min<uint64_t>(budget.Room(), 64)));
  }

  SceneOptions options_;
  bool complete_;
  int tiers_ = 1, columns_ = 1;
};

}  // namespace

std::unique_ptr<Scene> MakeStadium(const SceneOptions& options) { return std::make_unique<Stadium>(options); }

}  // namespace quarry::scenes

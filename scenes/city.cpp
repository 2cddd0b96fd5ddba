#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/random.h"
#include "scenes/scene.h"
#include "scenes/shapes.h"

namespace quarry::scenes {
namespace {

using glm::vec2;
using glm::vec3;

enum CityMaterial : uint16_t {
  kAsphalt,
  kPavement,
  kBrick,
  kPlaster,
  kStoneWall,
  kWindow,
  kMirrorGlass,
  kRoof,
  kMetal,
  kLamp,
  kCityMaterials
};

constexpr float kLot = 24.0f, kStreet = 14.0f;
constexpr int kLots = 3;  ///< A block is 3 x 3 lots, the one in the middle a court.
constexpr float kBlock = kLots * kLot + kStreet;

class City : public Scene {
 public:
  explicit City(const SceneOptions& options) : options_(options) {
    const double n = static_cast<double>(options.triangles);
    const double building = std::clamp(1200 * std::pow(n / 1e6, 0.4), 45.0, 16000.0);
    const double blocks = 0.95 * n / (building * 8);
    columns_ = std::max(1, static_cast<int>(std::sqrt(blocks) + 0.5));
    rows_ = std::max(1, static_cast<int>(blocks / columns_));
  }

  std::vector<Material> Materials() const override {
    std::vector<Material> m(kCityMaterials);
    const auto set = [&](CityMaterial i, const char* name, const vec3& diffuse) {
      m[i].name = name;
      m[i].diffuse = diffuse;
    };
    set(kAsphalt, "asphalt", vec3(0.11f));
    set(kPavement, "pavement", vec3(0.42f, 0.41f, 0.39f));
    set(kBrick, "brick", {0.52f, 0.24f, 0.17f});
    set(kPlaster, "plaster", {0.80f, 0.74f, 0.62f});
    set(kStoneWall, "stone", {0.58f, 0.56f, 0.52f});
    set(kWindow, "window", {0.05f, 0.07f, 0.09f});
    m[kWindow].reflectance = m[kWindow].specular = vec3(0.3f);
    m[kWindow].shininess = 400;
    set(kMirrorGlass, "mirror glass", {0.04f, 0.08f, 0.10f});
    m[kMirrorGlass].reflectance = m[kMirrorGlass].specular = {0.5f, 0.6f, 0.65f};
    m[kMirrorGlass].shininess = 800;
    set(kRoof, "roof", {0.33f, 0.20f, 0.16f});
    set(kMetal, "metal", vec3(0.5f));
    set(kLamp, "lamp", vec3(0.8f));
    m[kLamp].emission = vec3(4.0f, 3.4f, 2.4f);
    return m;
  }

  void Draw(Builder& b) const override {
    const double n = static_cast<double>(options_.triangles);
    const Budget buildings(b, static_cast<uint64_t>(0.96 * n));
    DrawGround(b);
    const auto blocks = static_cast<uint64_t>(columns_) * static_cast<uint64_t>(rows_);
    for (int y = 0; y < rows_; ++y)
      for (int x = 0; x < columns_; ++x) {
        const uint64_t block =
            static_cast<uint64_t>(y) * static_cast<uint64_t>(columns_) + static_cast<uint64_t>(x);
        DrawBlock(b, block, {kBlock * static_cast<float>(x), kBlock * static_cast<float>(y), 0},
                  buildings.Next(buildings.Share(blocks - block)));
      }
    DrawLamps(b);
  }

  std::vector<CameraFrame> Path() const override {
    const float wide = kBlock * static_cast<float>(columns_),
                street = kBlock * static_cast<float>(columns_ / 2) - 0.5f * kStreet;
    const float deep = kBlock * static_cast<float>(rows_);
    const float run = std::min(deep, 700.0f);
    const std::array<CameraKey, 5> keys{
        {{{-0.2f * wide - 60, -0.2f * deep - 60, 160}, {0.4f * wide, 0.4f * deep, 10}},
         {{street, -80, 60}, {street, 40, 20}},
         {{street, -20, 4}, {street, 60, 10}},
         {{street, 0.6f * run, 3}, {street, 0.6f * run + 50, 14}},
         {{street, run, 90}, {street + 60, run + 60, 10}}}};
    return WalkAlong(keys, 60, 60);
  }

 private:
  void DrawGround(Builder& b) const {
    b.Part("streets");
    b.Use(kAsphalt);
    const float wide = kBlock * static_cast<float>(columns_), deep = kBlock * static_cast<float>(rows_);
    Sheet(b, {-200 - kStreet, -200 - kStreet, 0}, {wide + 400, 0, 0}, {0, deep + 400, 0});
  }

  void DrawBlock(Builder& b, uint64_t block, const vec3& corner, Budget budget) const {
    b.Part(fmt::format("pavement of block {}", block));
    b.Use(kPavement);
    Box(b, corner + vec3(0, 0, -0.1f), corner + vec3(kLots * kLot, kLots * kLot, 0.15f));
    uint64_t left = kLots * kLots - 1;
    for (int y = 0; y < kLots; ++y)
      for (int x = 0; x < kLots; ++x) {
        if (x == 1 && y == 1) continue;
        const vec3 lot = corner + vec3(kLot * static_cast<float>(x), kLot * static_cast<float>(y), 0.15f);
        DrawBuilding(b, block * 16 + left, lot, budget.Next(budget.Share(left)));
        --left;
      }
  }

  /// A wall from `corner` along u (to the right, seen from outside), with recessed windows.
  struct Facade {
    vec3 corner, u;
    float height;
    uint16_t wall, pane;
    vec3 tint;
  };
  static constexpr double kWindowTriangles = 18;

  static void DrawWindowBay(Builder& b, const Facade& f, const vec3& low, const vec3& u, const vec3& v,
                            const vec3& in) {
    const std::array<vec2, 4> outer{vec2{0, 0}, {1, 0}, {1, 1}, {0, 1}},
        inner{vec2{0.22f, 0.2f}, {0.78f, 0.2f}, {0.78f, 0.82f}, {0.22f, 0.82f}};
    b.BeginShape();
    b.Use(f.wall, f.tint);
    std::array<uint32_t, 4> o, i, d;
    for (size_t k = 0; k < 4; ++k) {
      o[k] = b.Vertex(low + u * outer[k].x + v * outer[k].y);
      i[k] = b.Vertex(low + u * inner[k].x + v * inner[k].y);
      d[k] = b.Vertex(low + u * inner[k].x + v * inner[k].y + in);
    }
    for (size_t k = 0; k < 4; ++k) {
      const size_t next = (k + 1) % 4;
      b.Quad(o[k], o[next], i[next], i[k]);
      b.Quad(i[k], i[next], d[next], d[k]);
    }
    b.Use(f.pane);
    b.Quad(d[0], d[1], d[2], d[3]);
  }

  static void DrawFacade(Builder& b, const Facade& f, double triangles) {
    const vec3 in = 0.25f * glm::normalize(glm::cross(vec3(0, 0, 1), f.u));
    const float length = glm::length(f.u);
    const int windows = static_cast<int>(triangles / kWindowTriangles);
    if (windows < 1) {
      b.Use(f.wall, f.tint);
      return Sheet(b, f.corner, f.u, {0, 0, f.height});
    }
    const int rows = std::clamp(
        static_cast<int>(std::sqrt(static_cast<float>(windows) * f.height / length) + 0.5f), 1, windows);
    const int columns = std::max(1, windows / rows);
    const vec3 u = f.u / static_cast<float>(columns), v(0, 0, f.height / static_cast<float>(rows));
    for (int j = 0; j < rows; ++j)
      for (int i = 0; i < columns; ++i)
        DrawWindowBay(b, f, f.corner + u * static_cast<float>(i) + v * static_cast<float>(j), u, v, in);
  }

  /// Four facades and a flat roof with a parapet; returns nothing above `high`.
  static void DrawStorey(Builder& b, const vec3& low, const vec3& high, const Facade& look,
                         double triangles) {
    const vec3 size = high - low;
    const float around = 2 * (size.x + size.y);
    const std::array<std::pair<vec3, vec3>, 4> sides{{{low, {size.x, 0, 0}},
                                                      {{high.x, low.y, low.z}, {0, size.y, 0}},
                                                      {{high.x, high.y, low.z}, {-size.x, 0, 0}},
                                                      {{low.x, high.y, low.z}, {0, -size.y, 0}}}};
    for (const auto& [corner, u] : sides) {
      Facade facade = look;
      facade.corner = corner;
      facade.u = u;
      facade.height = size.z;
      DrawFacade(b, facade, triangles * glm::length(u) / around);
    }
    b.Use(kRoof, look.tint);
    Sheet(b, {low.x, low.y, high.z}, {size.x, 0, 0}, {0, size.y, 0});
  }

  static void DrawGable(Builder& b, const vec3& low, const vec3& high) {
    b.BeginShape();
    b.Use(kRoof);
    const float y = 0.5f * (low.y + high.y), o = 0.4f;
    const std::array<uint32_t, 6> v{
        b.Vertex({low.x - o, low.y - o, low.z}),   b.Vertex({high.x + o, low.y - o, low.z}),
        b.Vertex({high.x + o, high.y + o, low.z}), b.Vertex({low.x - o, high.y + o, low.z}),
        b.Vertex({low.x - o, y, high.z}),          b.Vertex({high.x + o, y, high.z})};
    b.Quad(v[0], v[1], v[5], v[4]);
    b.Quad(v[2], v[3], v[4], v[5]);
    b.Triangle(v[0], v[4], v[3]);
    b.Triangle(v[1], v[2], v[5]);
    b.Quad(v[0], v[3], v[2], v[1]);
  }

  static void DrawRoundTower(Builder& b, const vec3& center, float radius, float height, const Facade& look,
                             double triangles) {
    const int sides = std::clamp(static_cast<int>(std::sqrt(triangles) / 2), 6, 48);
    for (int i = 0; i < sides; ++i) {
      const float a0 = 2 * kPi * static_cast<float>(i) / static_cast<float>(sides),
                  a1 = 2 * kPi * static_cast<float>(i + 1) / static_cast<float>(sides);
      Facade facade = look;
      facade.corner = center + radius * vec3(std::cos(a0), std::sin(a0), 0);
      facade.u = center + radius * vec3(std::cos(a1), std::sin(a1), 0) - facade.corner;
      facade.height = height;
      DrawFacade(b, facade, triangles * 0.9 / sides);
    }
    b.Use(kRoof);
    const std::array<vec2, 2> roof{vec2{radius, height}, {0, height + 0.3f * radius}};
    Lathe(b, center, {0, 0, 1}, roof, sides);
  }

  static void DrawRoofClutter(Builder& b, const vec3& low, const vec3& high, Budget budget, Random& random) {
    while (budget.Room() > 40 && random.Chance(0.85f)) {
      const vec3 at(random.Uniform(low.x + 1, high.x - 2), random.Uniform(low.y + 1, high.y - 2), high.z);
      b.Use(kMetal, vec3(random.Uniform(0.5f, 1.0f)));
      if (random.Chance(0.5f)) {
        Box(b, at,
            at + vec3(random.Uniform(0.5f, 1.5f), random.Uniform(0.5f, 1.5f), random.Uniform(0.4f, 1.6f)));
      } else {
        Cylinder(b, at, at + vec3(0, 0, random.Uniform(0.8f, 2.5f)), random.Uniform(0.15f, 0.6f), 8);
      }
    }
  }

  void DrawBuilding(Builder& b, uint64_t id, const vec3& lot, Budget budget) const {
    Random random(options_.seed, 1, id);
    b.Part(fmt::format("building {}", id));
    constexpr std::array<uint16_t, 3> kWalls{kBrick, kPlaster, kStoneWall};
    Facade look{{},
                {},
                0,
                kWalls[random.Below(3)],
                random.Chance(0.25f) ? uint16_t{kMirrorGlass} : uint16_t{kWindow},
                vec3(random.Uniform(0.65f, 1.0f), random.Uniform(0.65f, 0.95f), random.Uniform(0.6f, 0.95f))};
    const vec3 low = lot + vec3(random.Uniform(0.8f, 3.0f), random.Uniform(0.8f, 3.0f), 0);
    const vec3 size(kLot - random.Uniform(5.0f, 8.0f), kLot - random.Uniform(5.0f, 8.0f), 0);
    const float tall = random.Uniform() * random.Uniform(),
                height = 7.0f + 70.0f * tall * tall + 12.0f * random.Uniform();
    const double all = static_cast<double>(budget.Room());
    const float kind = random.Uniform();
    vec3 high = low + size + vec3(0, 0, height);
    if (kind < 0.45f) {
      DrawStorey(b, low, high, look, 0.88 * all);
    } else if (kind < 0.65f && all > 60) {  // Setbacks.
      const vec3 in = 0.14f * size;
      const vec3 middle(0, 0, 0.6f * height);
      DrawStorey(b, low, low + size + middle, look, 0.6 * all);
      DrawStorey(b, low + in + middle, high - in, look, 0.28 * all);
    } else if (kind < 0.82f) {
      high.z = low.z + std::min(height, 11.0f);
      DrawStorey(b, low, high, look, 0.85 * all);
      DrawGable(b, {low.x, low.y, high.z + 0.01f}, high + vec3(0, 0, 4.5f));
      return;
    } else {
      const float radius = 0.5f * std::min(size.x, size.y);
      return DrawRoundTower(b, low + 0.5f * size, radius, height, look, 0.9 * all);
    }
    if (kind < 0.45f) DrawRoofClutter(b, low, high, budget, random);
  }

  /// Street lamps along the streets, as many as are left to draw.
  void DrawLamps(Builder& b) const {
    const Budget budget(b, options_.triangles);
    const uint64_t count = budget.Room() / 44;
    const double length = kBlock * static_cast<double>(columns_) * rows_;
    for (uint64_t i = 0; i < count && budget.Room() >= 44; ++i) {
      const double along = length * (static_cast<double>(i) + 0.5) / static_cast<double>(count);
      const double deep = kBlock * static_cast<double>(rows_);
      const auto street = static_cast<float>(std::floor(along / deep));
      const vec3 foot(kBlock * street - 1.0f, static_cast<float>(std::fmod(along, deep)), 0);
      DrawLamp(b, i, foot);
    }
    b.Part("markers");
    b.Use(kLamp);
    for (int i = 0; budget.Room() > 0; ++i)
      Spike(b, {-4.0f - static_cast<float>(i), -4, 0}, 0.2f, 1,
            static_cast<int>(std::min<uint64_t>(budget.Room(), 64)));
  }

  void DrawLamp(Builder& b, uint64_t i, const vec3& foot) const {
    Random random(options_.seed, 2, i);
    const float height = random.Uniform(5.2f, 6.4f);
    b.Part(fmt::format("lamp {}", i));
    b.Use(kMetal);
    Cylinder(b, foot, foot + vec3(0, 0, height), 0.08f, 5);
    Beam(b, foot + vec3(0.06f, 0, height), foot + vec3(-1.4f, 0, height), 0.07f, 0.07f);
    b.Use(kLamp);
    Box(b, foot + vec3(-1.4f, -0.12f, height - 0.16f), foot + vec3(-0.9f, 0.12f, height - 0.04f));
  }

  SceneOptions options_;
  int columns_ = 1, rows_ = 1;
};

}  // namespace

std::unique_ptr<Scene> MakeCity(const SceneOptions& options) { return std::make_unique<City>(options); }

}  // namespace quarry::scenes

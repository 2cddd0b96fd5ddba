#include "scenes/terrain.h"

#include <array>
#include <cmath>

#include "scenes/random.h"
#include "scenes/scene.h"
#include "scenes/shapes.h"
#include "scenes/surface.h"

namespace quarry::scenes {

using glm::vec2;
using glm::vec3;

namespace {

constexpr float kSnowLine = 380.0f;
/// Odd and far apart, so that different lattice points have different keys.
constexpr uint64_t kAlongX = 0x9E3779B97F4A7C15ull, kAlongY = 0xC2B2AE3D27D4EB4Full;

}  // namespace

float HeightField::Noise(float x, float y, uint32_t octave) const {
  const float fx = std::floor(x), fy = std::floor(y);
  const auto i = static_cast<uint64_t>(static_cast<int64_t>(fx)),
             j = static_cast<uint64_t>(static_cast<int64_t>(fy));
  const uint64_t key = Mix(seed_ + octave) + i * kAlongX + j * kAlongY;
  const auto value = [](uint64_t corner) { return static_cast<float>(Mix(corner) >> 40) * 0x1p-24f; };
  const float u = x - fx, v = y - fy;
  const float su = u * u * u * (u * (6 * u - 15) + 10), sv = v * v * v * (v * (6 * v - 15) + 10);
  return glm::mix(glm::mix(value(key), value(key + kAlongX), su),
                  glm::mix(value(key + kAlongY), value(key + kAlongX + kAlongY), su), sv);
}

float HeightField::At(float x, float y) const {
  float frequency = 4.0f / extent_, amplitude = 0.5f, sum = 0.0f, ridge = 1.0f;
  for (uint32_t octave = 0; octave < 11; ++octave) {
    // Ridges, damped in the valleys: mountains are rough and plains are smooth (Musgrave's multifractal).
    const float n = Noise(x * frequency, y * frequency, octave);
    const float crest = 1.0f - std::abs(2.0f * n - 1.0f);
    sum += amplitude * ridge * crest;
    ridge = glm::clamp(0.3f + crest * 0.9f, 0.0f, 1.0f) * ridge;
    amplitude *= 0.5f;
    frequency *= 2.03f;
  }
  return height_ * (sum * sum * 1.3f - 0.12f);
}

void HeightField::Draw(Builder& b, double triangles, uint16_t material) const {
  const GridSize size = FitGrid(triangles, 1.0);
  const float dx = extent_ / static_cast<float>(size.columns), dy = extent_ / static_cast<float>(size.rows);
  static const std::array<vec3, 4> kTints{
      vec3(0.76f, 0.69f, 0.50f), {0.30f, 0.47f, 0.18f}, {0.48f, 0.44f, 0.40f}, vec3(0.95f)};
  const auto tint = [&](float z, float slope) {
    const float h = z / height_;
    vec3 colour = glm::mix(kTints[0], kTints[1], glm::smoothstep(0.0f, 0.06f, h));
    colour = glm::mix(colour, kTints[2], glm::smoothstep(0.5f, 1.0f, slope));
    const float snow =
        glm::smoothstep(kSnowLine, 1.2f * kSnowLine, z) * (1.0f - glm::smoothstep(0.9f, 1.5f, slope));
    return glm::mix(colour, kTints[3], snow);
  };
  // Heights are expensive: the slope is taken towards the vertices before this one, kept from the tile's last
  // row. At a tile's edges they are computed anew, which gives the neighbouring tile the same tints there.
  std::array<float, kSurfaceTile> below{};
  float z = 0;
  TiledSurface(
      b, "ground", size.columns, size.rows,
      [&](uint64_t i, uint64_t j) { return vec3(static_cast<float>(i) * dx, static_cast<float>(j) * dy, z); },
      [&](uint64_t i, uint64_t j) {
        if (!b.wants_positions()) return b.Use(material);
        const float x = static_cast<float>(i) * dx, y = static_cast<float>(j) * dy;
        const bool left_edge = i % kSurfaceTile == 0, low_edge = j % kSurfaceTile == 0;
        const float left = left_edge ? At(x - dx, y) : z;
        const float low = left_edge || low_edge ? At(x, y - dy) : below[i % kSurfaceTile];
        z = below[i % kSurfaceTile] = At(x, y);
        b.Use(material, tint(z, glm::length(vec2((z - left) / dx, (z - low) / dy))));
      });
}

namespace {

enum TerrainMaterial : uint16_t { kTerrainGround, kWater, kStone };

class Terrain : public Scene {
 public:
  explicit Terrain(const SceneOptions& options) : options_(options), field_(options.seed, 4000.0f, 650.0f) {}

  std::vector<Material> Materials() const override {
    std::vector<Material> materials(3);
    materials[kTerrainGround].name = "ground";
    materials[kTerrainGround].diffuse = vec3(1.0f);
    materials[kWater].name = "water";
    materials[kWater].diffuse = vec3(0.02f, 0.07f, 0.1f);
    materials[kWater].reflectance = materials[kWater].specular = vec3(0.6f);
    materials[kWater].shininess = 200;
    materials[kWater].fresnel = true;
    materials[kStone].name = "stone";
    materials[kStone].diffuse = vec3(0.45f, 0.43f, 0.4f);
    return materials;
  }

  void Draw(Builder& b) const override {
    const double n = static_cast<double>(options_.triangles);
    field_.Draw(b, 0.97 * n, kTerrainGround);
    b.Part("water");
    b.Use(kWater);
    Sheet(b, {0, 0, 0}, {field_.extent(), 0, 0}, {0, field_.extent(), 0});
    DrawStones(b);
  }

  std::vector<CameraFrame> Path() const override {
    std::vector<CameraFrame> path;
    for (int i = 0; i < 60; ++i) {
      const float t = static_cast<float>(i) / 59.0f, angle = 1.0f + 3.5f * t,
                  reach = glm::mix(0.45f, 0.2f, t);
      const float x = field_.extent() * (0.5f + reach * std::cos(angle));
      const float y = field_.extent() * (0.5f + reach * std::sin(angle));
      CameraFrame frame;
      frame.eye = {x, y, std::max(field_.At(x, y), 0.0f) + glm::mix(400.0f, 60.0f, t)};
      frame.at = {0.5f * field_.extent(), 0.5f * field_.extent(), 150.0f};
      frame.fov = 55;
      path.push_back(frame);
    }
    return path;
  }

 private:
  /// Boulders use up the triangles that the grid leaves.
  void DrawStones(Builder& b) const {
    const Budget budget(b, options_.triangles);
    for (uint64_t i = 0; budget.Room() > 0; ++i) {
      Random random(options_.seed, 77, i);
      const float x = random.Uniform(0.0f, field_.extent()), y = random.Uniform(0.0f, field_.extent());
      const float radius = random.Uniform(0.4f, 3.0f);
      const vec3 at(x, y, field_.At(x, y));
      if (i % 64 == 0) b.Part("stones " + std::to_string(i / 64));
      b.Use(kStone, vec3(random.Uniform(0.6f, 1.0f)));
      if (budget.Room() < 60)
        return Spike(b, at - vec3(0, 0, 0.2f), radius, radius, static_cast<int>(budget.Room()));
      DrawStone(b, at, radius, random);
    }
  }

  static void DrawStone(Builder& b, const vec3& at, float radius, Random& random) {
    std::array<vec2, 5> profile{vec2{0, -1}, {0.7f, -0.6f}, {1, 0}, {0.6f, 0.55f}, {0, 0.8f}};
    for (vec2& p : profile) p *= radius * random.Uniform(0.75f, 1.2f);
    const vec3 axis(random.Uniform(-0.4f, 0.4f), random.Uniform(-0.4f, 0.4f), 1.0f);
    Lathe(b, at, axis, profile, 5 + static_cast<int>(random.Below(4)));
  }

  SceneOptions options_;
  HeightField field_;
};

}  // namespace

std::unique_ptr<Scene> MakeTerrain(const SceneOptions& options) { return std::make_unique<Terrain>(options); }

}  // namespace quarry::scenes

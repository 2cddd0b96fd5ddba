#include "scenes/plant/plant.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/scene.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

struct Look {
  const char* name;
  vec3 diffuse;
  float specular, shininess, reflectance;
};

constexpr std::array<Look, kPlantMaterials> kLooks{
    {{"concrete", {0.55f, 0.54f, 0.51f}, 0.0f, 0, 0},
     {"cladding", {0.58f, 0.64f, 0.68f}, 0.1f, 20, 0},
     {"steel", {0.36f, 0.37f, 0.39f}, 0.3f, 40, 0},
     {"galvanised", {0.62f, 0.64f, 0.65f}, 0.3f, 30, 0},
     {"blue paint", {0.12f, 0.25f, 0.55f}, 0.2f, 60, 0},
     {"green paint", {0.16f, 0.42f, 0.22f}, 0.2f, 60, 0},
     {"yellow paint", {0.85f, 0.66f, 0.08f}, 0.2f, 60, 0},
     {"red paint", {0.62f, 0.10f, 0.08f}, 0.2f, 60, 0},
     {"white paint", {0.82f, 0.82f, 0.80f}, 0.1f, 30, 0},
     {"grey paint", {0.45f, 0.47f, 0.48f}, 0.1f, 30, 0},
     {"copper", {0.72f, 0.38f, 0.22f}, 0.4f, 80, 0},
     {"rubber", {0.05f, 0.05f, 0.055f}, 0.05f, 10, 0},
     {"insulation", {0.74f, 0.73f, 0.69f}, 0.15f, 25, 0},
     {"chrome", {0.08f, 0.08f, 0.08f}, 0.75f, 800, 0.75f},
     {"polished steel", {0.25f, 0.25f, 0.26f}, 0.45f, 300, 0.45f},
     {"window glass", {0.0f, 0.0f, 0.0f}, 0.9f, 1000, 0.9f},
     {"gravel", {0.42f, 0.40f, 0.36f}, 0.0f, 0, 0},
     {"rust", {0.35f, 0.19f, 0.11f}, 0.0f, 0, 0}}};

Material FromLook(const Look& look) {
  Material material;
  material.name = look.name;
  material.diffuse = look.diffuse;
  material.specular = vec3(look.specular);
  material.shininess = look.shininess;
  material.reflectance = vec3(look.reflectance);
  return material;
}

/// A stage and its share of the triangles in a small plant (1,000 triangles, mostly walls) and in a large
/// plant.
struct Stage {
  void (*draw)(Plant&, Budget);
  double small, large;
};

constexpr std::array<Stage, 7> kStages{{{DrawShell, 0.42, 0.02},
                                        {DrawFrame, 0.14, 0.03},
                                        {DrawFloors, 0.08, 0.13},
                                        {DrawBoilers, 0.12, 0.24},
                                        {DrawEquipment, 0.09, 0.33},
                                        {DrawRacks, 0.09, 0.22},
                                        {DrawBolts, 0.06, 0.03}}};

class PowerPlant : public Scene {
 public:
  explicit PowerPlant(const SceneOptions& options) : options_(options) {}

  std::vector<Material> Materials() const override {
    std::vector<Material> materials;
    for (const Look& look : kLooks) materials.push_back(FromLook(look));
    materials[kPane].transmittance = vec3(0.86f, 0.92f, 0.90f);
    materials[kPane].ior = 1.5f;
    materials[kPane].fresnel = true;
    if (options_.lamps == 0) return materials;
    Material& tube = materials.emplace_back();
    tube.name = "tube";
    tube.emission = vec3(60, 55, 45);
    return materials;
  }

  void Draw(Builder& builder) const override {
    DrawLamps(builder);
    const double of_lamps = 2 * static_cast<double>(options_.lamps);
    const double n = static_cast<double>(options_.triangles) - of_lamps;
    Plant plant{builder, options_.seed, n, std::max(13.0, 115 * std::pow(n / 1e6, 0.36))};
    const double smallness = std::pow(1000.0 / n, 0.3);
    double share = 0;
    for (const Stage& stage : kStages) {
      share += stage.large + smallness * (stage.small - stage.large);
      const bool last = &stage == &kStages.back();
      stage.draw(plant,
                 Budget(builder, last ? options_.triangles : static_cast<uint64_t>(of_lamps + share * n)));
    }
  }

  /// Around a corner to the door, in, around the walkway, up between the boilers, and out on the fifth level.
  std::vector<CameraFrame> Path() const override {
    const std::array<CameraKey, 16> keys{{{{-75, -55, 30}, {25, 20, 38}},
                                          {{-55, -20, 12}, {25, 20, 36}},
                                          {{-28, 8, 3}, {10, 18, 14}},
                                          {{-9, 16.5f, 1.8f}, {10, 17.5f, 3}},
                                          {{2, 17.5f, 1.7f}, {20, 17.5f, 3}},
                                          {{12.5f, 17.5f, 1.7f}, {17, 24, 8}},
                                          {{12.5f, 12, 1.7f}, {14, 5, 3}},
                                          {{12.6f, 7.6f, 1.7f}, {24, 8, 4}},
                                          {{24, 7.6f, 1.7f}, {28, 13, 5}},
                                          {{24.1f, 11.2f, 2.2f}, {25, 22, 12}},
                                          {{25, 11.4f, 16}, {25, 22, 24}},
                                          {{25, 11.4f, 30}, {25, 24, 40}},
                                          {{24, 11, 41.7f}, {18, 8, 44}},
                                          {{24, 7.6f, 41.7f}, {36, 7, 43}},
                                          {{37.4f, 7.6f, 41.7f}, {38, 16, 43}},
                                          {{37.6f, 24, 41.7f}, {30, 34, 44}}}};
    return WalkAlong(keys, 60, 65);
  }

 private:
  /// Tubes below the ceilings of all levels, each a strip that shines to both sides.
  void DrawLamps(Builder& builder) const {
    constexpr float kLength = 1.2f, kWidth = 0.1f;
    for (uint64_t i = 0; i < options_.lamps; ++i) {
      Random random(options_.seed, 70, i, 0);
      const vec3 corner(random.Uniform(0.5f, kSizeX - 2), random.Uniform(0.5f, kSizeY - 2),
                        kLevel * (static_cast<float>(i % kLevels) + 1) - random.Uniform(0.6f, 1.6f));
      const bool turned = random.Chance(0.5f);
      const vec3 along = (turned ? vec3(0, 1, 0) : vec3(1, 0, 0)) * kLength;
      const vec3 across = (turned ? vec3(1, 0, 0) : vec3(0, 1, 0)) * kWidth;
      builder.Part(fmt::format("tube {}", i));
      builder.Use(kPlantMaterials);
      builder.BeginShape();
      const uint32_t a = builder.Vertex(corner), b = builder.Vertex(corner + along);
      const uint32_t c = builder.Vertex(corner + along + across), d = builder.Vertex(corner + across);
      builder.Quad(a, b, c, d);
    }
  }

  SceneOptions options_;
};

}  // namespace

std::unique_ptr<Scene> MakePlant(const SceneOptions& options) {
  return std::make_unique<PowerPlant>(options);
}

}  // namespace quarry::scenes

#include <array>

#include "scenes/scene.h"
#include "scenes/shapes.h"
#include "scenes/surface.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

enum CornellMaterial : uint16_t { kWhite, kRed, kGreen, kLight, kMirror, kGlass };

/// The size of the box; the open side is y = 0.
constexpr float kSide = 2.0f;

struct Square {
  const char* name;
  uint16_t material;
  vec3 corner, u, v;  // u x v points into the box.
};

constexpr std::array<Square, 5> kSquares{
    {{"floor", kWhite, {0, 0, 0}, {kSide, 0, 0}, {0, kSide, 0}},
     {"ceiling", kWhite, {0, 0, kSide}, {0, kSide, 0}, {kSide, 0, 0}},
     {"back wall", kWhite, {0, kSide, 0}, {kSide, 0, 0}, {0, 0, kSide}},
     {"left wall", kRed, {0, 0, 0}, {0, kSide, 0}, {0, 0, kSide}},
     {"right wall", kGreen, {kSide, 0, 0}, {0, 0, kSide}, {0, kSide, 0}}}};

Material Named(const char* name, const vec3& diffuse) {
  Material material;
  material.name = name;
  material.diffuse = diffuse;
  return material;
}

class Cornell : public Scene {
 public:
  explicit Cornell(const SceneOptions& options) : options_(options) {}

  std::vector<Material> Materials() const override {
    Material light = Named("light", vec3(0.78f));
    light.emission = vec3(17.0f, 12.0f, 4.0f);
    Material mirror = Named("mirror", vec3(0.0f));
    mirror.reflectance = mirror.specular = vec3(0.95f);
    mirror.shininess = 1000;
    Material glass = Named("glass", vec3(0.0f));
    glass.reflectance = glass.specular = vec3(1.0f);
    glass.transmittance = vec3(0.95f, 0.98f, 0.96f);
    glass.shininess = 1000;
    glass.ior = 1.5f;
    glass.fresnel = true;
    return {Named("white", vec3(0.73f)),
            Named("red", vec3(0.63f, 0.06f, 0.05f)),
            Named("green", vec3(0.14f, 0.45f, 0.09f)),
            light,
            mirror,
            glass};
  }

  void Draw(Builder& b) const override {
    const double n = static_cast<double>(options_.triangles);
    for (const Square& square : kSquares) DrawSquare(b, square, 0.08 * n);
    DrawBall(b, "mirror ball", kMirror, {0.62f, 1.3f, 0.42f}, 0.42f, 0.28 * n);
    DrawBall(b, "glass ball", kGlass, {1.38f, 0.75f, 0.42f}, 0.42f, 0.28 * n);
    DrawLight(b);
  }

  std::vector<CameraFrame> Path() const override {
    const std::array<CameraKey, 4> keys{{{{1.0f, -2.6f, 1.0f}, {1, 1, 0.9f}},
                                         {{1.3f, -1.0f, 1.1f}, {1, 1, 0.7f}},
                                         {{0.7f, -0.1f, 1.3f}, {1, 1.2f, 0.5f}},
                                         {{0.4f, 0.3f, 1.5f}, {1.2f, 1, 0.4f}}}};
    return WalkAlong(keys, 60, 45);
  }

 private:
  static void DrawSquare(Builder& b, const Square& s, double triangles) {
    const GridSize size = FitGrid(triangles, 1.0);
    TiledSurface(
        b, s.name, size.columns, size.rows,
        [&](uint64_t i, uint64_t j) {
          return s.corner + s.u * (static_cast<float>(i) / static_cast<float>(size.columns)) +
                 s.v * (static_cast<float>(j) / static_cast<float>(size.rows));
        },
        [&](uint64_t, uint64_t) { b.Use(s.material); });
  }

  /// A cube blown up to a ball: no degenerate triangles at poles.
  static void DrawBall(Builder& b, const std::string& name, uint16_t material, const vec3& center,
                       float radius, double triangles) {
    const GridSize size = FitGrid(triangles / 6, 1.0);
    const auto edge = [](uint64_t i, uint64_t count) {
      return std::tan(0.25f * kPi * (2.0f * static_cast<float>(i) / static_cast<float>(count) - 1.0f));
    };
    for (int side = 0; side < 6; ++side) {
      const int axis = side / 2;
      const float sign = side % 2 ? 1.0f : -1.0f;
      vec3 z(0), x(0);
      z[axis] = sign;
      x[(axis + 1) % 3] = 1.0f;
      const vec3 y = glm::cross(z, x);
      TiledSurface(
          b, name + " side " + std::to_string(side), size.columns, size.rows,
          [&](uint64_t i, uint64_t j) {
            return center + radius * glm::normalize(z + edge(i, size.columns) * x + edge(j, size.rows) * y);
          },
          [&](uint64_t, uint64_t) { b.Use(material); });
    }
  }

  /// The lamp: squares, then a disc in their middle of as many sectors as are left, so that the count comes
  /// out even.
  void DrawLight(Builder& b) const {
    const Budget budget(b, options_.triangles);
    b.Use(kLight);
    const float z = kSide - 0.002f;
    uint64_t left = budget.Room();
    const GridSize size = FitGrid(static_cast<double>(left - std::min<uint64_t>(left, 48)), 1.0);
    const auto at = [](uint64_t i, uint64_t count) {
      return 0.5f * kSide - 0.25f + 0.5f * static_cast<float>(i) / static_cast<float>(count);
    };
    TiledSurface(
        b, "light", size.columns, size.rows,
        [&](uint64_t i, uint64_t j) { return vec3(at(j, size.rows), at(i, size.columns), z); },
        [](uint64_t, uint64_t) {});
    while ((left = budget.Room()) > 0) {
      // The bulb under the lamp, in pieces that fit a shape.
      b.Part("bulb " + std::to_string(left));
      Spike(b, {0.5f * kSide, 0.5f * kSide, z - 0.1f}, 0.05f, 0.08f,
            static_cast<int>(std::min<uint64_t>(left, 4096)));
    }
  }

  SceneOptions options_;
};

}  // namespace

std::unique_ptr<Scene> MakeCornell(const SceneOptions& options) { return std::make_unique<Cornell>(options); }

}  // namespace quarry::scenes

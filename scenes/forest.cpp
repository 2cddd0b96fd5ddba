#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/random.h"
#include "scenes/scene.h"
#include "scenes/shapes.h"
#include "scenes/terrain.h"

namespace quarry::scenes {
namespace {

using glm::vec3;

enum ForestMaterial : uint16_t { kGround, kBark, kLeaf, kNeedle, kPond, kForestMaterials };

/// Half the width of the ride that is kept free of trees for the camera.
constexpr float kRide = 5.0f, kSpacing = 5.0f;

class Forest : public Scene {
 public:
  explicit Forest(const SceneOptions& options)
      : options_(options),
        side_(Side(options)),
        field_(options.seed, kSpacing * static_cast<float>(side_),
               0.035f * kSpacing * static_cast<float>(side_)) {}

  std::vector<Material> Materials() const override {
    std::vector<Material> m(kForestMaterials);
    m[kGround].name = "ground";
    m[kGround].diffuse = vec3(0.7f);
    m[kBark].name = "bark";
    m[kBark].diffuse = {0.34f, 0.25f, 0.18f};
    m[kLeaf].name = "leaves";
    m[kLeaf].diffuse = {0.30f, 0.52f, 0.14f};
    m[kNeedle].name = "needles";
    m[kNeedle].diffuse = {0.12f, 0.30f, 0.14f};
    m[kPond].name = "pond";
    m[kPond].diffuse = {0.03f, 0.05f, 0.05f};
    m[kPond].reflectance = m[kPond].specular = vec3(0.5f);
    m[kPond].shininess = 300;
    m[kPond].fresnel = true;
    return m;
  }

  void Draw(Builder& b) const override {
    const double n = static_cast<double>(options_.triangles);
    field_.Draw(b, 0.12 * n, kGround);
    DrawPond(b);
    const Budget trees(b, options_.triangles - static_cast<uint64_t>(0.02 * n));
    const uint64_t count = side_ * side_;
    for (uint64_t i = 0; i < count; ++i) DrawTree(b, i, trees.Next(trees.Share(count - i)));
    DrawGrass(b);
  }

  std::vector<CameraFrame> Path() const override {
    const float extent = field_.extent(), start = -0.25f;
    std::vector<CameraFrame> path;
    for (int i = 0; i < 60; ++i) {
      const float t = static_cast<float>(i) / 59.0f, y = extent * glm::mix(start, 0.8f, t);
      const float above = glm::mix(40.0f, 3.0f, glm::smoothstep(0.0f, 0.45f, t));
      CameraFrame frame;
      frame.eye = {0.5f * extent, y, Height(0.5f * extent, y) + above};
      const float ahead = y + 30.0f;
      frame.at = {0.5f * extent + 8.0f * std::sin(6 * t), ahead,
                  Height(0.5f * extent, ahead) + 0.35f * above + 3.0f};
      path.push_back(frame);
    }
    return path;
  }

 private:
  static uint64_t Side(const SceneOptions& options) {
    const double n = static_cast<double>(options.triangles);
    const double tree = std::max(60.0, 900 * std::pow(n / 1e6, 0.35));
    return static_cast<uint64_t>(std::max(3.0, std::sqrt(0.85 * n / tree)));
  }

  float Height(float x, float y) const {
    return field_.At(glm::clamp(x, 0.0f, field_.extent()), glm::clamp(y, 0.0f, field_.extent()));
  }

  vec3 OnGround(float x, float y) const { return {x, y, Height(x, y)}; }

  void DrawPond(Builder& b) const {
    b.Part("pond");
    b.Use(kPond);
    Sheet(b, {0, 0, 0}, {field_.extent(), 0, 0}, {0, field_.extent(), 0});
  }

  /// A branch and all branches and leaves on it, for `depth` levels.
  struct Growth {
    Builder& b;
    Random& random;
    Budget wood, all;
    bool conifer;
    int segments;
    vec3 bark, leaf;
    int leaves_per_tip;
    float leaf_size;
  };

  static void DrawLeaves(Growth& g, const vec3& center, float spread) {
    for (int i = 0; i < g.leaves_per_tip && g.all.Room() >= 2; ++i) {
      Random& r = g.random;
      const vec3 at = center + spread * vec3(r.Uniform(-1, 1), r.Uniform(-1, 1), r.Uniform(-0.7f, 0.9f));
      const float angle = r.Uniform(0, 2 * kPi), tilt = r.Uniform(-0.8f, 0.8f),
                  size = g.leaf_size * r.Uniform(0.6f, 1.3f);
      const vec3 u(std::cos(angle) * size, std::sin(angle) * size, tilt * size);
      const vec3 v = 0.6f * size * vec3(-std::sin(angle), std::cos(angle), r.Uniform(-0.6f, 0.6f));
      g.b.Use(g.conifer ? kNeedle : kLeaf, g.leaf * r.Uniform(0.7f, 1.0f));
      // A rhombus: stalk, sides, tip.
      g.b.BeginShape();
      const uint32_t first = g.b.Vertex(at);
      g.b.Vertex(at + 0.5f * u + 0.5f * v);
      g.b.Vertex(at + u);
      g.b.Vertex(at + 0.5f * u - 0.5f * v);
      g.b.Quad(first, first + 1, first + 2, first + 3);
    }
  }

  static void DrawBranch(Growth& g, const vec3& from, const vec3& direction, float length, float radius,
                         int depth) {
    Random& r = g.random;
    const Frame frame(direction);
    const vec3 bend = frame.x * r.Uniform(-0.15f, 0.15f) + frame.y * r.Uniform(-0.15f, 0.15f);
    const vec3 middle = from + length * (0.5f * frame.z + bend),
               to = middle + length * (0.5f * frame.z + 0.4f * bend);
    g.b.Use(kBark, g.bark);
    DrawTaper(g.b, from, middle, to, radius, g.segments);
    if (depth == 0 || g.wood.Room() < 12) return DrawLeaves(g, to, 0.55f * length);
    const int children = g.conifer ? 4 : 2 + static_cast<int>(r.Below(3));
    for (int i = 0; i < children; ++i) {
      const float angle =
          2 * kPi * (static_cast<float>(i) + r.Uniform(0, 0.7f)) / static_cast<float>(children);
      const float open = r.Uniform(0.35f, 0.95f);
      const vec3 out =
          frame.z + open * (std::cos(angle) * frame.x + std::sin(angle) * frame.y) + vec3(0, 0, 0.1f);
      const float where = r.Uniform(0.55f, 1.0f);
      const vec3 start = where < 0.75f ? glm::mix(from, middle, 0.98f) : to;
      DrawBranch(g, start, out, length * r.Uniform(0.6f, 0.8f), 0.6f * radius, depth - 1);
    }
  }

  /// A limb in two pieces, thinner towards its end, open where others grow from it.
  static void DrawTaper(Builder& b, const vec3& from, const vec3& middle, const vec3& to, float radius,
                        int segments) {
    const std::array<glm::vec2, 2> low{glm::vec2{radius, 0}, {0.75f * radius, glm::distance(from, middle)}};
    Lathe(b, from, middle - from, low, segments);
    const std::array<glm::vec2, 2> high{glm::vec2{0.75f * radius, 0},
                                        {0.45f * radius, glm::distance(middle, to)}};
    Lathe(b, middle, to - middle, high, segments);
  }

  void DrawTree(Builder& b, uint64_t index, Budget budget) const {
    Random random(options_.seed, 10, index);
    const float x = kSpacing * (static_cast<float>(index % side_) + random.Uniform(0.1f, 0.9f));
    const float y = kSpacing * (static_cast<float>(index / side_) + random.Uniform(0.1f, 0.9f));
    const float ride = 0.5f * field_.extent();
    if (std::abs(x - ride) < kRide || Height(x, y) < 0.2f) return;  // The next trees take its share.
    b.Part(fmt::format("tree {}", index));
    const double all = static_cast<double>(budget.Room());
    const bool conifer = random.Chance(0.4f);
    const int depth = std::clamp(static_cast<int>(std::log(all / 40) / std::log(3.2)), 0, 6);
    Growth growth{b,
                  random,
                  budget.Next(0.45 * all),
                  budget,
                  conifer,
                  std::clamp(static_cast<int>(std::cbrt(all) / 2.5), 3, 10),
                  vec3(random.Uniform(0.7f, 1.0f)),
                  {random.Uniform(0.7f, 1.0f), random.Uniform(0.75f, 1.0f), random.Uniform(0.5f, 1.0f)},
                  0,
                  0};
    const double tips = std::pow(conifer ? 4.0 : 3.0, depth);
    growth.leaves_per_tip = std::max(2, static_cast<int>(0.3 * all / tips));
    growth.leaf_size = glm::clamp(static_cast<float>(13.0 / std::sqrt(all)), 0.06f, 1.2f);
    const vec3 foot = OnGround(x, y) - vec3(0, 0, 0.3f);
    const float length = random.Uniform(2.2f, 3.8f);
    const vec3 lean(random.Uniform(-0.1f, 0.1f), random.Uniform(-0.1f, 0.1f), 1);
    if (conifer) return DrawConifer(growth, foot, lean, 2.6f * length);
    DrawBranch(growth, foot, lean, length, random.Uniform(0.14f, 0.26f), depth);
  }

  /// One straight stem with whorls of branches that get shorter towards the top.
  static void DrawConifer(Growth& g, const vec3& foot, const vec3& lean, float height) {
    Random& r = g.random;
    const vec3 axis = glm::normalize(lean);
    g.b.Use(kBark, g.bark);
    DrawTaper(g.b, foot, foot + 0.5f * height * axis, foot + height * axis, 0.018f * height, g.segments);
    const double all = static_cast<double>(g.all.Room());
    const int branches = std::clamp(static_cast<int>(all / 40), 6, 400);
    for (int i = 0; i < branches && g.all.Room() > 4; ++i) {
      const float t = (static_cast<float>(i) + 0.5f) / static_cast<float>(branches);
      const vec3 start = foot + axis * (height * (0.18f + 0.8f * t));
      const float angle = 2.39996f * static_cast<float>(i) + r.Uniform(-0.2f, 0.2f),
                  reach = 0.26f * height * (1.05f - t);
      const vec3 out(std::cos(angle), std::sin(angle), -0.25f);
      g.b.Use(kBark, g.bark);
      const std::array<glm::vec2, 2> twig{glm::vec2{0.012f * reach + 0.01f, 0}, {0, reach}};
      Lathe(g.b, start, out, twig, 3);
      const Budget share = g.all.Next(g.all.Share(static_cast<uint64_t>(branches - i)));
      DrawSprays(g, start, glm::normalize(out), reach, share);
    }
  }

  static void DrawSprays(Growth& g, const vec3& start, const vec3& out, float reach, Budget budget) {
    Random& r = g.random;
    const vec3 side(-out.y, out.x, 0);
    const auto count = static_cast<int>(budget.Room());
    const float size = std::min(0.9f, 1.6f / std::sqrt(static_cast<float>(count + 1))) * reach;
    g.b.Use(kNeedle, g.leaf * r.Uniform(0.7f, 1.0f));
    for (int k = 0; k < count; ++k) {
      const float along = (static_cast<float>(k) + r.Uniform(0.3f, 1.0f)) / static_cast<float>(count),
                  hand = k % 2 ? 1.0f : -1.0f;
      const vec3 at = start + out * (reach * along * 0.9f);
      g.b.BeginShape();
      const uint32_t first = g.b.Vertex(at);
      g.b.Vertex(at + 0.4f * size * out);
      g.b.Vertex(at + size * (0.7f * out + hand * r.Uniform(0.5f, 0.9f) * side +
                              vec3(0, 0, r.Uniform(-0.35f, 0.1f))));
      g.b.Triangle(first, first + 1, first + 2);
    }
  }

  /// Blades on the ground, one triangle each, until the count is exact.
  void DrawGrass(Builder& b) const {
    const Budget budget(b, options_.triangles);
    for (uint64_t i = 0; budget.Room() > 0; ++i) {
      Random random(options_.seed, 11, i);
      if (i % 4096 == 0) b.Part(fmt::format("grass {}", i / 4096));
      const vec3 at = OnGround(random.Uniform(0, field_.extent()), random.Uniform(0, field_.extent()));
      b.Use(kLeaf, vec3(random.Uniform(0.5f, 1.0f)));
      Spike(b, at - vec3(0, 0, 0.02f), 0.12f, random.Uniform(0.15f, 0.5f), 1);
    }
  }

  SceneOptions options_;
  uint64_t side_;
  HeightField field_;
};

}  // namespace

std::unique_ptr<Scene> MakeForest(const SceneOptions& options) { return std::make_unique<Forest>(options); }

}  // namespace quarry::scenes

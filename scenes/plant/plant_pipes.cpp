#include <algorithm>
#include <array>
#include <cmath>

#include "scenes/plant/plant.h"
#include "scenes/shapes.h"

namespace quarry::scenes {

using glm::vec2;
using glm::vec3;

int SegmentsFor(double triangles, int rows, int most) {
  return std::clamp(static_cast<int>(triangles / (2.0 * rows)), 3, most);
}

vec3 Worn(Random& random) {
  const float light = random.Uniform(0.72f, 1.0f), warm = random.Uniform(0.0f, 0.06f);
  return {light, light * (1.0f - warm), light * (1.0f - 2.0f * warm)};
}

uint16_t PipeMaterial(float radius, Random& random) {
  constexpr std::array<uint16_t, 6> kThin{kCopper, kChrome, kGalvanised, kSteel, kRubber, kYellowPaint};
  constexpr std::array<uint16_t, 8> kThick{kInsulation, kInsulation, kBluePaint, kGreenPaint,
                                           kRedPaint,   kGreyPaint,  kPolished,  kRust};
  if (radius < 0.05f) return kThin[random.Below(kThin.size())];
  return kThick[random.Below(kThick.size())];
}

namespace {

/// Splits a pipe's triangles between the segments around, the bends and the rows along it.
TubeStyle FitTube(int points, float radius, double triangles) {
  TubeStyle style;
  style.radius = radius;
  style.bend_radius = 3.0f * radius;
  const int bends = points - 2;
  // Around a bend as fine as around the pipe: segments^2 is proportional to the triangles.
  const double fineness = std::sqrt(triangles / (4.0 + 0.8 * bends));
  style.segments = std::clamp(static_cast<int>(fineness), 3, 40);
  style.bend_steps = std::clamp(static_cast<int>(style.segments * 0.35), 1, 10);
  style.leg_steps = 1;
  while (style.segments > 3 && TubeTriangles(points, style) > triangles) --style.segments;
  const double rows = triangles / (2.0 * style.segments) - 1 - bends * style.bend_steps;
  style.leg_steps = std::clamp(static_cast<int>(rows / (points - 1)), 1, 24);
  return style;
}

/// A pair of discs around the pipe with bolts through them.
void DrawFlange(Builder& b, const vec3& at, const vec3& axis, float radius, int segments, int bolts) {
  const float wide = 1.55f * radius, half = 0.22f * radius;
  const std::array<vec2, 4> profile{
      vec2{0.98f * radius, -half}, {wide, -half}, {wide, half}, {0.98f * radius, half}};
  Lathe(b, at, axis, profile, segments);
  const Frame frame(axis);
  for (int i = 0; i < bolts; ++i) {
    const float angle = 2.0f * kPi * (static_cast<float>(i) + 0.5f) / static_cast<float>(bolts);
    const vec3 out = std::cos(angle) * frame.x + std::sin(angle) * frame.y;
    const vec3 center = at + out * (1.27f * radius);
    Bolt(b, center + half * frame.z, frame.z, 0.11f * radius, 0.1f * radius);
    Bolt(b, center - half * frame.z, -frame.z, 0.11f * radius, 0.1f * radius);
  }
}

/// A valve body with a stem and a hand wheel that points away from the pipe.
void DrawValve(Builder& b, const vec3& at, const vec3& axis, float radius, int segments) {
  Sphere(b, at, 1.5f * radius, segments, std::max(3, segments / 2));
  const Frame frame(axis);
  const vec3 top = at + 3.4f * radius * frame.x;
  Cylinder(b, at + 1.3f * radius * frame.x, top, 0.25f * radius, std::max(4, segments / 2));
  b.Use(kRedPaint);
  Torus(b, top, frame.x, 1.3f * radius, 0.14f * radius, segments, std::max(3, segments / 3));
  Beam(b, top - 1.25f * radius * frame.y, top + 1.25f * radius * frame.y, 0.14f * radius, 0.14f * radius);
  Beam(b, top - 1.25f * radius * frame.z, top + 1.25f * radius * frame.z, 0.14f * radius, 0.14f * radius);
}

/// The middle of a random leg, long enough for fittings; false if there is none.
bool PickPlace(std::span<const vec3> points, float radius, Random& random, vec3& at, vec3& axis) {
  for (int attempt = 0; attempt < 4; ++attempt) {
    const size_t leg = random.Below(static_cast<uint32_t>(points.size() - 1));
    const vec3 along = points[leg + 1] - points[leg];
    const float length = glm::length(along), margin = 4.5f * radius;
    const float where = random.Uniform(margin, length - margin);
    if (length < 2.5f * margin) continue;
    axis = along / length;
    at = points[leg] + where * axis;
    return true;
  }
  return false;
}

}  // namespace

void DrawPipe(Plant& plant, std::span<const vec3> points, float radius, double triangles, Random& random) {
  Builder& b = plant.b;
  const uint16_t material = PipeMaterial(radius, random);
  const vec3 tint = Worn(random);
  b.Use(material, tint);
  const uint64_t first = b.triangles();
  const auto left = [&] { return triangles - static_cast<double>(b.triangles() - first); };
  const TubeStyle style =
      FitTube(static_cast<int>(points.size()), radius, triangles > 200 ? 0.5 * triangles : triangles);
  Tube(b, points, style);
  const int segments = std::clamp(style.segments, 6, 32);
  vec3 at, axis;
  bool valve = false;
  while (left() > 6 * segments && PickPlace(points, radius, random, at, axis)) {
    const int bolts =
        std::clamp(static_cast<int>((left() - 6 * segments) / (2.0 * kBoltTriangles)), 0, 4 + segments / 4);
    if (!valve && left() > segments * (3 * segments) + 100 && random.Chance(0.5f)) {
      DrawValve(b, at, axis, radius, segments);
      valve = true;
    } else {
      b.Use(radius < 0.05f ? material : uint16_t{kSteel}, tint);
      DrawFlange(b, at, axis, radius, segments, bolts);
    }
  }
}

}  // namespace quarry::scenes

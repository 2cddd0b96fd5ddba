#include "scenes/shapes.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace quarry::scenes {

using glm::vec2;
using glm::vec3;

Frame::Frame(const vec3& axis) : z(glm::normalize(axis)) {
  const vec3 other = std::abs(z.z) < 0.9f ? vec3(0, 0, 1) : vec3(1, 0, 0);
  x = glm::normalize(glm::cross(other, z));
  y = glm::cross(z, x);
}

void OrientedBox(Builder& b, const vec3& center, const vec3& x, const vec3& y, const vec3& z) {
  b.BeginShape();
  std::array<uint32_t, 8> v;
  for (uint32_t i = 0; i < 8; ++i)
    v[i] = b.Vertex(center + (i & 1 ? x : -x) + (i & 2 ? y : -y) + (i & 4 ? z : -z));
  b.Quad(v[0], v[2], v[3], v[1]);
  b.Quad(v[4], v[5], v[7], v[6]);
  b.Quad(v[0], v[1], v[5], v[4]);
  b.Quad(v[2], v[6], v[7], v[3]);
  b.Quad(v[0], v[4], v[6], v[2]);
  b.Quad(v[1], v[3], v[7], v[5]);
}

void Box(Builder& b, const vec3& low, const vec3& high) {
  const vec3 half = 0.5f * (high - low);
  OrientedBox(b, 0.5f * (low + high), {half.x, 0, 0}, {0, half.y, 0}, {0, 0, half.z});
}

void Beam(Builder& b, const vec3& from, const vec3& to, float width, float height) {
  const Frame frame(to - from);
  OrientedBox(b, 0.5f * (from + to), 0.5f * width * frame.x, 0.5f * height * frame.y, 0.5f * (to - from));
}

void IBeam(Builder& b, const vec3& from, const vec3& to, const vec3& up, float width, float height) {
  const vec3 z = glm::normalize(to - from);
  const vec3 x = glm::normalize(glm::cross(up, z));
  const vec3 y = glm::cross(z, x);
  const float w = 0.5f * width, h = 0.5f * height, t = 0.12f * height, s = 0.06f * width;
  const std::array<vec2, 12> outline{vec2{-w, -h}, {w, -h},     {w, t - h},  {s, t - h},
                                     {s, h - t},   {w, h - t},  vec2{w, h},  {-w, h},
                                     {-w, h - t},  {-s, h - t}, {-s, t - h}, {-w, t - h}};
  b.BeginShape();
  std::array<uint32_t, 12> bottom, top;
  for (size_t i = 0; i < 12; ++i) {
    bottom[i] = b.Vertex(from + x * outline[i].x + y * outline[i].y);
    top[i] = b.Vertex(to + x * outline[i].x + y * outline[i].y);
  }
  for (size_t i = 0; i < 12; ++i) b.Quad(bottom[i], bottom[(i + 1) % 12], top[(i + 1) % 12], top[i]);
  // Each end is three rectangles: flange, web, flange; their T-joints do not show.
  const int pieces[3][4] = {{0, 1, 2, 11}, {10, 3, 4, 9}, {8, 5, 6, 7}};
  for (const auto& p : pieces) {
    b.Quad(top[p[0]], top[p[1]], top[p[2]], top[p[3]]);
    b.Quad(bottom[p[3]], bottom[p[2]], bottom[p[1]], bottom[p[0]]);
  }
}

void Sheet(Builder& b, const vec3& corner, const vec3& u, const vec3& v) {
  b.BeginShape();
  const uint32_t first = b.Vertex(corner);
  b.Vertex(corner + u);
  b.Vertex(corner + u + v);
  b.Vertex(corner + v);
  b.Quad(first, first + 1, first + 2, first + 3);
}

namespace {

struct Ring {
  uint32_t first;
  bool point;
};

void Join(Builder& b, const Ring& low, const Ring& high, int segments) {
  for (int i = 0; i < segments; ++i) {
    const uint32_t j = static_cast<uint32_t>((i + 1) % segments), k = static_cast<uint32_t>(i);
    if (low.point) {
      b.Triangle(low.first, high.first + j, high.first + k);
    } else if (high.point) {
      b.Triangle(low.first + k, low.first + j, high.first);
    } else {
      b.Quad(low.first + k, low.first + j, high.first + j, high.first + k);
    }
  }
}

Ring AddRing(Builder& b, const vec3& center, const vec3& x, const vec3& y, float radius, int segments) {
  if (radius <= 0.0f) return {b.Vertex(center), true};
  const float step = 2.0f * kPi / static_cast<float>(segments);
  Ring ring{0, false};
  for (int i = 0; i < segments; ++i) {
    const float angle = step * static_cast<float>(i);
    const uint32_t v = b.Vertex(center + radius * (std::cos(angle) * x + std::sin(angle) * y));
    if (i == 0) ring.first = v;
  }
  return ring;
}

}  // namespace

void Lathe(Builder& b, const vec3& origin, const vec3& axis, std::span<const vec2> profile, int segments) {
  const Frame frame(axis);
  b.BeginShape();
  Ring last{0, true};
  for (size_t i = 0; i < profile.size(); ++i) {
    const Ring ring = AddRing(b, origin + frame.z * profile[i].y, frame.x, frame.y, profile[i].x, segments);
    if (i > 0) Join(b, last, ring, segments);
    last = ring;
  }
}

void Cylinder(Builder& b, const vec3& from, const vec3& to, float radius, int segments) {
  const float length = glm::length(to - from);
  const std::array<vec2, 4> profile{vec2{0, 0}, {radius, 0}, {radius, length}, {0, length}};
  Lathe(b, from, to - from, profile, segments);
}

void Vessel(Builder& b, const vec3& from, const vec3& to, float radius, float dome, int segments, int rows) {
  const float length = glm::length(to - from);
  std::array<vec2, 130> profile;
  rows = std::clamp(rows, 1, 64);
  size_t count = 0;
  for (int i = 0; i <= rows; ++i) {
    const float angle = 0.5f * kPi * static_cast<float>(i) / static_cast<float>(rows);
    profile[count++] = {i == 0 ? 0.0f : radius * std::sin(angle), dome * (1.0f - std::cos(angle))};
  }
  for (int i = rows; i >= 0; --i) profile[count++] = {profile[i].x, length - profile[i].y};
  Lathe(b, from, to - from, std::span(profile.data(), count), segments);
}

void Sphere(Builder& b, const vec3& center, float radius, int segments, int rows) {
  std::array<vec2, 129> profile;
  rows = std::clamp(rows, 2, 128);
  for (int i = 0; i <= rows; ++i) {
    const float angle = kPi * static_cast<float>(i) / static_cast<float>(rows);
    profile[i] = {i == 0 || i == rows ? 0.0f : radius * std::sin(angle), -radius * std::cos(angle)};
  }
  Lathe(b, center, {0, 0, 1}, std::span(profile.data(), rows + 1), segments);
}

void Torus(Builder& b, const vec3& center, const vec3& axis, float ring_radius, float tube_radius,
           int segments, int sides) {
  const Frame frame(axis);
  b.BeginShape();
  std::array<Ring, 2> ends{};
  Ring last{0, false};
  for (int i = 0; i < segments; ++i) {
    const float angle = 2.0f * kPi * static_cast<float>(i) / static_cast<float>(segments);
    const vec3 out = std::cos(angle) * frame.x + std::sin(angle) * frame.y;
    const Ring ring = AddRing(b, center + ring_radius * out, frame.z, out, tube_radius, sides);
    if (i > 0) Join(b, last, ring, sides);
    if (i == 0) ends[0] = ring;
    last = ring;
  }
  Join(b, last, ends[0], sides);
}

void Bolt(Builder& b, const vec3& base, const vec3& axis, float radius, float height) {
  const Frame frame(axis);
  b.BeginShape();
  const Ring low = AddRing(b, base, frame.x, frame.y, radius, 6);
  const Ring high = AddRing(b, base + height * frame.z, frame.x, frame.y, radius, 6);
  Join(b, low, high, 6);
  for (uint32_t i = 1; i < 5; ++i) b.Triangle(high.first, high.first + i, high.first + i + 1);
}

namespace {

/// Carries a frame along a path without twist.
struct Carrier {
  vec3 x, y, z;
  explicit Carrier(const Frame& frame) : x(frame.x), y(frame.y), z(frame.z) {}
  /// Requires: `direction` is of unit length and not opposite to z.
  void Turn(const vec3& direction) {
    // The smallest rotation from z to `direction`; projecting x instead fails where the path turns along x.
    x -= (z + direction) * (glm::dot(x, direction) / (1.0f + glm::dot(z, direction)));
    z = direction;
    x = glm::normalize(x - z * glm::dot(x, z));
    y = glm::cross(z, x);
  }
};

/// The rings of a tube, one after the other.
struct Sweep {
  Builder& b;
  const TubeStyle& style;
  Carrier carrier;
  Ring last{0, true};

  void Add(const vec3& center) {
    const Ring ring = AddRing(b, center, carrier.x, carrier.y, style.radius, style.segments);
    if (!last.point) Join(b, last, ring, style.segments);
    last = ring;
  }
  void Leg(const vec3& from, const vec3& to) {
    for (int i = 1; i <= style.leg_steps; ++i)
      Add(glm::mix(from, to, static_cast<float>(i) / static_cast<float>(style.leg_steps)));
  }
  void Cap(const vec3& center, bool start) {
    const Ring ring = last;
    const uint32_t middle = b.Vertex(center);
    if (start) {
      Join(b, {middle, true}, ring, style.segments);
    } else {
      Join(b, ring, {middle, true}, style.segments);
    }
  }
};

/// The trim of both legs at a corner for a bend of the wanted radius, kept within the shorter leg's half.
float Trim(const vec3& in, const vec3& out, float longest, float bend_radius) {
  const float half_tangent = std::tan(0.5f * std::acos(std::clamp(glm::dot(in, out), -0.95f, 1.0f)));
  return std::min(bend_radius * half_tangent, longest);
}

}  // namespace

void Tube(Builder& b, std::span<const vec3> points, const TubeStyle& style) {
  b.BeginShape();
  vec3 in = glm::normalize(points[1] - points[0]);
  Sweep sweep{b, style, Carrier(Frame(in))};
  sweep.Add(points[0]);
  if (style.capped) sweep.Cap(points[0], true);
  vec3 from = points[0];
  for (size_t i = 1; i + 1 < points.size(); ++i) {
    const vec3 out = glm::normalize(points[i + 1] - points[i]);
    const float longest =
        0.49f * std::min(glm::distance(points[i - 1], points[i]), glm::distance(points[i], points[i + 1]));
    const float trim = Trim(in, out, longest, style.bend_radius);
    const vec3 start = points[i] - trim * in, end = points[i] + trim * out;
    sweep.Leg(from, start);
    for (int k = 1; k <= style.bend_steps; ++k) {
      // A quadratic Bezier arc: within 3 % of the circle for a right angle, and the same for any other.
      const float t = static_cast<float>(k) / static_cast<float>(style.bend_steps), s = 1.0f - t;
      sweep.carrier.Turn(glm::normalize(s * in + t * out));
      sweep.Add(s * s * start + 2.0f * s * t * points[i] + t * t * end);
    }
    from = end;
    in = out;
  }
  sweep.Leg(from, points.back());
  if (style.capped) sweep.Cap(points.back(), false);
}

int TubeTriangles(int points, const TubeStyle& style) {
  const int rows = (points - 1) * style.leg_steps + (points - 2) * style.bend_steps;
  return style.segments * (2 * rows + (style.capped ? 2 : 0));
}

void Spike(Builder& b, const vec3& base, float radius, float height, int count) {
  b.BeginShape();
  const Frame frame({0, 0, 1});
  const uint32_t apex = b.Vertex(base + vec3(0, 0, height));
  const int corners = std::max(count, 3);
  const Ring ring = AddRing(b, base, frame.x, frame.y, radius, corners);
  for (int i = 0; i < count; ++i)
    b.Triangle(ring.first + static_cast<uint32_t>(i), ring.first + static_cast<uint32_t>((i + 1) % corners),
               apex);
}

}  // namespace quarry::scenes

#pragma once

#include <glm/glm.hpp>
#include <span>

#include "scenes/builder.h"

/// Solids for the generators, closed unless stated, faces counter-clockwise from outside. Units: metres.
/// `segments` count around an axis (at least 3). A shape has at most 16,384 vertices; callers split finer
/// shapes.
namespace quarry::scenes {

inline constexpr float kPi = 3.14159265f;

/// An orthonormal frame with z along `axis` (any length but 0).
struct Frame {
  explicit Frame(const glm::vec3& axis);
  glm::vec3 x, y, z;
};

/// Axis-aligned; 12 triangles.
void Box(Builder& builder, const glm::vec3& low, const glm::vec3& high);

/// From the centre and three half edges that form a right-handed system; 12 triangles.
void OrientedBox(Builder& builder, const glm::vec3& center, const glm::vec3& x, const glm::vec3& y,
                 const glm::vec3& z);

/// A square beam of width `width` from `from` to `to`; 12 triangles.
void Beam(Builder& builder, const glm::vec3& from, const glm::vec3& to, float width, float height);

/// An I-section from `from` to `to`, `up` being across the flanges; 44 triangles.
void IBeam(Builder& builder, const glm::vec3& from, const glm::vec3& to, const glm::vec3& up, float width,
           float height);

/// A single-sided parallelogram at `corner`, normal u x v; 2 triangles.
void Sheet(Builder& builder, const glm::vec3& corner, const glm::vec3& u, const glm::vec3& v);

/// Turns `profile` (x: radius, y: height along the axis, from bottom to top for a surface seen from outside)
/// about the axis. Where the radius is 0 the surface closes in a fan. Triangles: segments per row with a
/// closed end, 2 segments per other row.
void Lathe(Builder& builder, const glm::vec3& origin, const glm::vec3& axis,
           std::span<const glm::vec2> profile, int segments);

/// A closed cylinder; 4 segments.
void Cylinder(Builder& builder, const glm::vec3& from, const glm::vec3& to, float radius, int segments);

/// A vessel with domed ends of `dome` height, `rows` per dome; segments (2 + 4 rows - 2).
void Vessel(Builder& builder, const glm::vec3& from, const glm::vec3& to, float radius, float dome,
            int segments, int rows);

/// segments (2 rows - 2).
void Sphere(Builder& builder, const glm::vec3& center, float radius, int segments, int rows);

/// A ring about `axis`; 2 segments sides.
void Torus(Builder& builder, const glm::vec3& center, const glm::vec3& axis, float ring_radius,
           float tube_radius, int segments, int sides);

/// A hexagonal bolt head that sits on a face with the outward normal `axis`; 16 triangles, open below.
inline constexpr int kBoltTriangles = 16;
void Bolt(Builder& builder, const glm::vec3& base, const glm::vec3& axis, float radius, float height);

struct TubeStyle {
  float radius = 0.1f;
  float bend_radius = 0.3f;  ///< Of the centre line; shortened where a leg is too short for it.
  int segments = 8;
  int bend_steps = 3;  ///< Rings per bend less one.
  int leg_steps = 1;   ///< Rows per straight leg.
  bool capped = true;
};

/// A pipe along `points` (at least 2, distinct neighbours) with round bends.
void Tube(Builder& builder, std::span<const glm::vec3> points, const TubeStyle& style);

/// Triangles of Tube() for so many points, if each inner point is a bend.
int TubeTriangles(int points, const TubeStyle& style);

/// Exactly `count` triangles (at least 1) as a small upright cone, open below; used to reach an exact count.
void Spike(Builder& builder, const glm::vec3& base, float radius, float height, int count);

}  // namespace quarry::scenes

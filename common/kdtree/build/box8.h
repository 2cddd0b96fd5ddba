#pragma once

#include <cstdint>
#include <cstring>
#include <glm/vec3.hpp>
#include <limits>

#include "common/kdtree/build/build.h"

namespace quarry {

/// The compiler's own vectors.
using Float4 = float __attribute__((vector_size(16)));
using Float8 = float __attribute__((vector_size(32)));
using Mask8 = int32_t __attribute__((vector_size(32)));

/// A box as one vector, used while voxels are decoded: lower x, y, z, an unused lane, upper x, y, z negated,
/// an unused lane. One minimum includes a box, and one maximum cuts it down. Scene units.
struct Box8 {
  Float8 faces;

  static Box8 Of(const Box& b) {
    return {Float8{b.lower.x, b.lower.y, b.lower.z, 0, -b.upper.x, -b.upper.y, -b.upper.z, 0}};
  }
  /// The inverse of Of().
  Box box() const { return {{faces[0], faces[1], faces[2]}, {-faces[4], -faces[5], -faces[6]}}; }
  /// The empty box: Include() makes it any other.
  static Box8 Empty() { return {Float8{} + std::numeric_limits<float>::infinity()}; }

  void Include(const Box8& other) { faces = faces < other.faces ? faces : other.faces; }
  Box8 Within(const Box8& cell) const { return {faces > cell.faces ? faces : cell.faces}; }
  Box8 Grown(float by) const { return {faces - by}; }
  /// The box with another lower, or upper, bound across `axis`.
  Box8 WithLower(int axis, float bound) const { return {Lane(axis) ? Float8{} + bound : faces}; }
  Box8 WithUpper(int axis, float bound) const { return {Lane(axis + 4) ? Float8{} - bound : faces}; }

  Float4 lower() const { return __builtin_shufflevector(faces, faces, 0, 1, 2, 3); }
  Float4 upper() const { return -__builtin_shufflevector(faces, faces, 4, 5, 6, 7); }

 private:
  static Mask8 Lane(int lane) { return Mask8{0, 1, 2, 3, 4, 5, 6, 7} == lane; }
};

/// The box of three points. Requires: a fourth float behind each point that may be read.
inline Box8 BoxOf(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c) {
  Float4 point[3];
  std::memcpy(&point[0], &a, sizeof(Float4));
  std::memcpy(&point[1], &b, sizeof(Float4));
  std::memcpy(&point[2], &c, sizeof(Float4));
  const auto less = [](Float4 x, Float4 y) { return x < y ? x : y; };
  const auto more = [](Float4 x, Float4 y) { return x > y ? x : y; };
  const Float4 lower = less(less(point[0], point[1]), point[2]);
  const Float4 upper = more(more(point[0], point[1]), point[2]);
  return {__builtin_shufflevector(lower, -upper, 0, 1, 2, 3, 4, 5, 6, 7)};
}

}  // namespace quarry

#pragma once

#include <cstdint>

namespace quarry {

// How normals are made for triangles that a model gives none, as a number of each triangle.

/// Triangles meet smoothly where the angle between them is at most the run's crease angle.
inline constexpr uint16_t kSmoothByAngle = 0;
/// The model states that they are flat.
inline constexpr uint16_t kFlat = 1;

/// The model gives them normals.
inline constexpr uint16_t kOwnNormals = 65535;

/// The number of a smoothing group of a file: its triangles meet smoothly whatever the angle, and others not
/// at all. Groups whose numbers are 65,533 apart are one. Thread-safe.
inline uint16_t SmoothingGroup(uint64_t group) { return static_cast<uint16_t>(2 + group % 65533); }

/// Makes a group of a file differ from the equal groups of other files. `file`: its number. Thread-safe.
inline uint16_t SmoothingOfFile(uint16_t smoothing, uint32_t file) {
  if (smoothing == kSmoothByAngle || smoothing == kFlat || smoothing == kOwnNormals) return smoothing;
  return SmoothingGroup(uint64_t{smoothing} - 2 + uint64_t{7919} * file);
}

}  // namespace quarry

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

/// The number of a smoothing group of the model: its triangles meet smoothly whatever the angle, and others
/// not at all. Beyond 65,533 groups of a file, numbers repeat. Thread-safe.
inline uint16_t SmoothingGroup(uint64_t group) { return static_cast<uint16_t>(2 + group % 65533); }

}  // namespace quarry

#pragma once

#include <cstdint>

namespace quarry {

/// The place of a triangle in the image of its opacity, from which its mask follows. Coordinates lie on a
/// grid that is finer than a texel, and repeated images are moved onto one, so that most triangles that show
/// the same piece of an image have equal places.
struct MaskPlace {
  /// Parts of a texel.
  static constexpr double kGrid = 64;

  uint32_t material = 0;
  int32_t corners[3][2] = {};  ///< x, y, in parts of a texel
  uint32_t slack[2] = {};      ///< how far beyond lookups may lie each way, in parts of a texel
};

}  // namespace quarry

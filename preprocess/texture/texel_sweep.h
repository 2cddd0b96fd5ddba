#pragma once

#include <array>

#include "common/scene/material.h"
#include "preprocess/texture/opacity_map.h"

namespace quarry {

/// A triangle in an image, and how far beyond it lookups may lie.
/// Units: texels; (0, 0) is the corner of the first texel.
struct TexelTriangle {
  std::array<std::array<double, 2>, 3> corners;  ///< x, y
  std::array<double, 2> slack{0, 0};             ///< each way
};

/// The states that all texels share that a lookup in the triangle, nearest or bilinear, can touch. Where rows
/// are too many to look at, the states that all texels of the image share. A lookup at x touches the texels
/// whose centres are less than 1 away. So row by row: the part of the triangle that is less than 1 from the
/// row's centre, and the columns about it.
TexelStates StatesAbout(const TexelTriangle& triangle, const OpacityMap& map, const OpacityTiles& tiles,
                        TextureWrap wrap_s, TextureWrap wrap_t);

}  // namespace quarry

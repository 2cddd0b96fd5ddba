#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "common/math/elementary.h"
#include "preprocess/import/model_sink.h"

namespace quarry {

/// Rounds a channel of 0 to 255; NaN gives 0.
inline uint8_t ColorByte(double value) {
  return static_cast<uint8_t>(value > 0 ? std::min(value, 255.0) + 0.5 : 0.0);
}

/// A colour of a PLY, OBJ, OFF or STL file. Units: 0 to 255 a channel, taken as sRGB, which the formats leave
/// open and most programs show.
inline Rgba8 FileColor(double r, double g, double b, double a = 255) {
  static const std::array<uint8_t, 256> kLinear = [] {
    std::array<uint8_t, 256> linear;
    for (int i = 0; i < 256; ++i) linear[i] = ColorByte(DecodeSrgb(i / 255.0) * 255);
    return linear;
  }();
  return {kLinear[ColorByte(r)], kLinear[ColorByte(g)], kLinear[ColorByte(b)], ColorByte(a)};
}

}  // namespace quarry

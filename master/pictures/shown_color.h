#pragma once

#include <cstddef>
#include <cstdint>

#include "common/math/elementary.h"
#include "common/scene/view.h"

namespace quarry {

/// A linear value after a tone curve. Film's is the identity up to 1/2 and goes on with the same slope as
/// 1 - 1/(4x), which nears 1. Thread-safe.
inline double Toned(ToneCurve curve, double linear) {
  return curve == ToneCurve::kClip || !(linear > 0.5) ? linear : 1 - 0.25 / linear;
}

/// A channel as a picture shows it: 8 bits of sRGB of the exposed and toned radiance before kBackdrop.
/// `radiance`: of the samples that cover a share `coverage` of the pixel. `gain`: of the exposure, 2^EV.
/// Thread-safe.
inline uint8_t ShownByte(float radiance, double gain, float coverage, size_t channel, ToneCurve curve) {
  const double behind = (1 - static_cast<double>(coverage)) * kBackdrop[channel];
  return static_cast<uint8_t>(EncodeSrgb(Toned(curve, static_cast<double>(radiance) * gain) + behind) * 255 +
                              0.5);
}

}  // namespace quarry

#pragma once

#include <cstddef>
#include <cstdint>

#include "common/math/elementary.h"
#include "common/scene/view.h"

namespace quarry {

/// A channel as a picture shows it: 8 bits of sRGB of the exposed radiance before kBackdrop. `radiance`: of
/// the samples that cover a share `coverage` of the pixel. `gain`: of the exposure, 2^EV. Thread-safe.
inline uint8_t ShownByte(float radiance, double gain, float coverage, size_t channel) {
  const double behind = (1 - static_cast<double>(coverage)) * kBackdrop[channel];
  return static_cast<uint8_t>(EncodeSrgb(static_cast<double>(radiance) * gain + behind) * 255 + 0.5);
}

}  // namespace quarry

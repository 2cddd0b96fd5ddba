#pragma once

#include <cstdint>

#include "common/base/status.h"
#include "tests/laboratory/memory.h"

namespace quarry::laboratory {

/// Three floats of a texture.
struct Float3 {
  float x, y, z;
};

/// The corners of triangles, scene units: a texture for each of the three. Kernels may have a copy.
struct TriangleCorners {
  Texture<Float3> corner[3];
  uint32_t count = 0;

  /// Calls f(texture) for each texture that kernels read.
  template <class F>
  Status ForTextures(const F& f) {
    for (Texture<Float3>& texture : corner) QUARRY_TRY(f(texture));
    return {};
  }
};

}  // namespace quarry::laboratory

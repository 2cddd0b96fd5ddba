#pragma once

#include <cstdint>
#include <glm/glm.hpp>

#include "scenes/builder.h"

namespace quarry::scenes {

/// A fractal height field, the same function of place for each seed, whatever the tessellation.
class HeightField {
 public:
  /// `extent`: the side of the square [0,extent]^2 it is drawn over; `height`: about its greatest height.
  HeightField(uint64_t seed, float extent, float height) : seed_(seed), extent_(extent), height_(height) {}

  float extent() const { return extent_; }
  float At(float x, float y) const;

  /// Draws the square with at most `triangles` triangles. Sand, grass, rock and
  /// snow are tints by height and slope of the one `material`, whose diffuse should be white.
  void Draw(Builder& builder, double triangles, uint16_t material) const;

 private:
  float Noise(float x, float y, uint32_t octave) const;

  uint64_t seed_;
  float extent_, height_;
};

}  // namespace quarry::scenes

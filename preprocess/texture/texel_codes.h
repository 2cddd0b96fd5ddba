#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// One row of stored texels as linear floats, colours multiplied by their alpha.
void ToLinear(std::span<const std::byte> texels, const TexelLayout& layout, std::vector<float>& linear);

/// And back, rounded to the nearest code; where alpha is 0 colours are too.
void FromLinear(const std::vector<float>& linear, const TexelLayout& layout, Bytes& texels);

/// The nearest code of 8 bits for a linear value; below 0 and NaN are 0, above 1 is 255.
std::byte ToByte(float linear);
std::byte ToSrgbByte(float linear);

}  // namespace quarry

#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// Decodes a row of stored texels to linear floats, colours multiplied by alpha. Thread-safe.
void ToLinear(std::span<const std::byte> texels, const TexelLayout& layout, std::vector<float>& linear);

/// Encodes linear floats, rounded to the nearest code; colours are 0 where alpha is 0. Thread-safe.
void FromLinear(const std::vector<float>& linear, const TexelLayout& layout, Bytes& texels);

/// The nearest 8-bit code of a linear value; below 0 and NaN give 0, above 1 gives 255.
std::byte ToByte(float linear);
std::byte ToSrgbByte(float linear);

}  // namespace quarry

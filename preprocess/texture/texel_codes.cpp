#include "preprocess/texture/texel_codes.h"

#include <algorithm>
#include <array>
#include <cstring>

#include "common/math/elementary.h"
#include "common/math/half.h"

namespace quarry {
namespace {

struct SrgbTable {
  std::array<float, 256> linear;     ///< of each code
  std::array<float, 255> threshold;  ///< between neighbouring codes, in linear light
  SrgbTable() {
    for (int i = 0; i < 256; ++i) linear[static_cast<size_t>(i)] = static_cast<float>(DecodeSrgb(i / 255.0));
    for (int i = 0; i < 255; ++i)
      threshold[static_cast<size_t>(i)] = static_cast<float>(DecodeSrgb((i + 0.5) / 255.0));
  }
};
const SrgbTable& Srgb() {
  static const SrgbTable table;
  return table;
}

float ReadHalf(const std::byte* at) {
  uint16_t half;
  std::memcpy(&half, at, sizeof half);
  return HalfToFloat(half);
}

}  // namespace

std::byte ToByte(float linear) {
  const float scaled = linear > 0 ? std::min(linear, 1.0f) * 255 + 0.5f : 0;
  return static_cast<std::byte>(static_cast<int>(scaled));
}

std::byte ToSrgbByte(float linear) {
  if (!(linear > 0)) return std::byte{0};
  const auto& threshold = Srgb().threshold;
  return static_cast<std::byte>(std::ranges::upper_bound(threshold, linear) - threshold.begin());
}

void ToLinear(std::span<const std::byte> texels, const TexelLayout& layout, std::vector<float>& linear) {
  const uint32_t channels = layout.channels, colors = channels - layout.has_alpha();
  linear.resize(size_t{layout.width} * channels);
  for (uint32_t x = 0; x < layout.width; ++x) {
    float* out = &linear[size_t{x} * channels];
    const std::byte* in = &texels[size_t{x} * layout.texel_bytes()];
    for (uint32_t c = 0; c < channels; ++c) {
      if (layout.format == TexelFormat::kHalf)
        out[c] = ReadHalf(in + 2 * size_t{c});
      else if (layout.format == TexelFormat::kSrgb8 && c < colors)
        out[c] = Srgb().linear[static_cast<size_t>(in[c])];
      else
        out[c] = static_cast<float>(in[c]) / 255;
    }
    if (layout.has_alpha())
      for (uint32_t c = 0; c < colors; ++c) out[c] *= out[colors];
  }
}

void FromLinear(const std::vector<float>& linear, const TexelLayout& layout, Bytes& texels) {
  const uint32_t channels = layout.channels, colors = channels - layout.has_alpha();
  const size_t count = linear.size() / channels;
  texels.resize(count * layout.texel_bytes());
  for (size_t i = 0; i < count; ++i) {
    const float* in = &linear[i * channels];
    std::byte* out = &texels[i * layout.texel_bytes()];
    for (uint32_t c = 0; c < channels; ++c) {
      float value = in[c];
      if (layout.has_alpha() && c < colors) value = in[colors] > 0 ? value / in[colors] : 0;
      if (layout.format == TexelFormat::kHalf) {
        const uint16_t half = FloatToHalf(value);
        std::memcpy(out + 2 * size_t{c}, &half, sizeof half);
      } else {
        out[c] = layout.format == TexelFormat::kSrgb8 && c < colors ? ToSrgbByte(value) : ToByte(value);
      }
    }
  }
}

}  // namespace quarry

#include "preprocess/texture/texel_codes.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "common/math/elementary.h"
#include "common/math/half.h"

namespace quarry {
namespace {

/// Steps of the table of codes: neighbouring thresholds are 1 / 3295 apart, or more.
constexpr size_t kSteps = 4096;

struct SrgbTable {
  std::array<float, 256> linear;  ///< of each code
  std::array<float, 256> share;   ///< of each code as a linear number
  std::array<float, 256>
      threshold;  ///< between neighbouring codes, in linear light; beyond the last infinity
  std::array<uint8_t, kSteps + 1> code;  ///< of i / kSteps; a step passes one threshold at most
  SrgbTable() {
    for (int i = 0; i < 256; ++i) {
      linear[static_cast<size_t>(i)] = static_cast<float>(DecodeSrgb(i / 255.0));
      share[static_cast<size_t>(i)] = static_cast<float>(i) / 255;
      threshold[static_cast<size_t>(i)] = i < 255 ? static_cast<float>(DecodeSrgb((i + 0.5) / 255.0))
                                                  : std::numeric_limits<float>::infinity();
    }
    for (size_t i = 0; i <= kSteps; ++i)
      code[i] = static_cast<uint8_t>(std::ranges::upper_bound(threshold, static_cast<float>(i) / kSteps) -
                                     threshold.begin());
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
  const SrgbTable& table = Srgb();
  const uint32_t code = table.code[static_cast<size_t>(std::min(linear, 1.0f) * kSteps)];
  return static_cast<std::byte>(code + (table.threshold[code] <= linear ? 1 : 0));
}

namespace {

/// Rows of 8-bit texels. `colors`, `numbers`: values of each code.
template <uint32_t kChannels>
void BytesToLinear(const std::byte* in, size_t width, const float* colors, const float* numbers, float* out) {
  constexpr bool kAlpha = kChannels % 2 == 0;
  constexpr uint32_t kColors = kChannels - kAlpha;
  for (size_t i = 0; i < width * kChannels; i += kChannels) {
    const float alpha = kAlpha ? numbers[static_cast<size_t>(in[i + kColors])] : 1;
    for (uint32_t c = 0; c < kColors; ++c) {
      const float value = colors[static_cast<size_t>(in[i + c])];
      out[i + c] = kAlpha ? value * alpha : value;
    }
    if (kAlpha) out[i + kColors] = alpha;
  }
}

}  // namespace

void ToLinear(std::span<const std::byte> texels, const TexelLayout& layout, std::vector<float>& linear) {
  const uint32_t channels = layout.channels, colors = channels - layout.has_alpha();
  linear.resize(size_t{layout.width} * channels);
  if (layout.format != TexelFormat::kHalf) {
    const float* numbers = Srgb().share.data();
    constexpr decltype(&BytesToLinear<1>) kRows[] = {BytesToLinear<1>, BytesToLinear<2>, BytesToLinear<3>,
                                                     BytesToLinear<4>};
    return kRows[channels - 1](texels.data(), layout.width,
                               layout.format == TexelFormat::kSrgb8 ? Srgb().linear.data() : numbers, numbers,
                               linear.data());
  }
  for (uint32_t x = 0; x < layout.width; ++x) {
    float* out = &linear[size_t{x} * channels];
    const std::byte* in = &texels[size_t{x} * layout.texel_bytes()];
    for (uint32_t c = 0; c < channels; ++c) out[c] = ReadHalf(in + 2 * size_t{c});
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

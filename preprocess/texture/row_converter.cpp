#include "preprocess/texture/row_converter.h"

#include <algorithm>
#include <cstring>

#include "common/base/check.h"
#include "common/math/elementary.h"
#include "common/math/half.h"

namespace quarry {
namespace {

/// Rec. 709's weights, applied to the values as they are.
uint8_t Luminance(uint8_t r, uint8_t g, uint8_t b) {
  return static_cast<uint8_t>((54u * r + 183u * g + 19u * b + 128u) >> 8);
}
float Luminance(float r, float g, float b) { return 0.2126f * r + 0.7152f * g + 0.0722f * b; }

}  // namespace

RowConverter::RowConverter(const ImageFacts& facts, bool color, TexturePick pick)
    : facts_(facts), pick_(pick) {
  const uint32_t alpha = facts.channels % 2 == 0, colors = facts.channels - alpha;
  layout_.width = facts.width;
  layout_.height = facts.height;
  layout_.channels = pick == TexturePick::kColor           ? colors
                     : pick == TexturePick::kColorAndAlpha ? facts.channels
                                                           : 1;
  layout_.format = facts.real ? TexelFormat::kHalf : color ? TexelFormat::kSrgb8 : TexelFormat::kLinear8;
  decode_ = color && facts.encoded;
}

template <class Sample>
void RowConverter::Pick(std::span<const std::byte> row, std::vector<Sample>& out) const {
  const uint32_t channels = facts_.channels, alpha = channels % 2 == 0, colors = channels - alpha;
  out.resize(size_t{facts_.width} * layout_.channels);
  Sample* to = out.data();
  for (uint32_t x = 0; x < facts_.width; ++x) {
    Sample in[4] = {};
    std::memcpy(in, &row[size_t{x} * channels * sizeof(Sample)], channels * sizeof(Sample));
    const Sample grey = colors == 3 ? Luminance(in[0], in[1], in[2]) : in[0];
    switch (pick_) {
      case TexturePick::kColor:
      case TexturePick::kColorAndAlpha:
        to = std::copy_n(in, layout_.channels, to);
        break;
      case TexturePick::kScalar:
        *to++ = alpha ? in[colors] : grey;
        break;
      case TexturePick::kLuminance:
        *to++ = grey;
        break;
      default: {
        const auto channel = static_cast<uint32_t>(pick_) - static_cast<uint32_t>(TexturePick::kRed);
        *to++ = colors == 3 ? in[channel] : in[0];
      }
    }
  }
}

std::span<const std::byte> RowConverter::Convert(std::span<const std::byte> row) {
  QUARRY_CHECK(row.size() == facts_.row_bytes());
  const bool all = (pick_ == TexturePick::kColor || pick_ == TexturePick::kColorAndAlpha) &&
                   layout_.channels == facts_.channels;
  if (!facts_.real && all) return row;
  if (!facts_.real) {
    Pick(row, bytes_);
    return std::as_bytes(std::span(bytes_));
  }
  Pick(row, reals_);
  texels_.resize(reals_.size() * 2);
  const uint32_t colors = layout_.channels - layout_.has_alpha();
  for (size_t i = 0; i < reals_.size(); ++i) {
    const bool is_color = i % layout_.channels < colors;
    const float value = decode_ && is_color ? static_cast<float>(DecodeSrgb(reals_[i])) : reals_[i];
    const uint16_t half = FloatToHalf(value);
    std::memcpy(&texels_[2 * i], &half, sizeof half);
  }
  return texels_;
}

}  // namespace quarry

#pragma once

#include <cstdint>
#include <string>

#include "common/base/bytes.h"
#include "common/scene/material.h"

namespace quarry {

/// The channels of an image that a texture takes.
enum class TexturePick : uint32_t {
  kColor,          ///< grey or RGB
  kColorAndAlpha,  ///< alpha too, if there is one
  kScalar,         ///< alpha if there is one, else luminance: masks come in both forms
  kLuminance,
  kRed,
  kGreen,
  kBlue,
};
inline constexpr uint32_t kTexturePicks = 7;

/// An image that a model refers to, not decoded: bytes of a file, or bytes that the model holds as text.
struct TextureImage {
  static constexpr uint64_t kToTheEnd = ~uint64_t{0};

  std::string file;                       ///< path; empty: the image is `content`
  uint64_t offset = 0, size = kToTheEnd;  ///< bytes, of the image in the file
  Bytes content;
  std::string name;   ///< the model's name for it
  std::string model;  ///< path of the file that refers to it
  bool color = true;  ///< 8 and 16 bits hold sRGB; false: numbers
  TexturePick pick = TexturePick::kColor;
};

/// A model's number as a store holds it: clamped to 1e30 either way, 0 for NaN.
inline float Bounded(float value) {
  constexpr float kMost = 1e30f;
  return value >= -kMost ? (value < kMost ? value : kMost) : value < 0 ? -kMost : 0;
}
inline TextureBinding Bounded(TextureBinding binding) {
  for (float& value : binding.transform) value = Bounded(value);
  for (int i = 0; i < 4; ++i) binding.factor[i] = Bounded(binding.factor[i]);
  binding.cutoff = Bounded(binding.cutoff);
  return binding;
}

}  // namespace quarry

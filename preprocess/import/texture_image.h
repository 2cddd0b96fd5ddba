#pragma once

#include <cstdint>
#include <string>

#include "common/base/bytes.h"
#include "common/scene/material.h"

namespace quarry {

/// Which of an image's channels a texture has.
enum class TexturePick : uint32_t {
  kColor,          ///< grey or RGB
  kColorAndAlpha,  ///< alpha too, if there is one
  kScalar,         ///< alpha if there is one, else luminance: masks come in both ways
  kLuminance,
  kRed,
  kGreen,
  kBlue,
};
inline constexpr uint32_t kTexturePicks = 7;

/// An image as a model refers to it: bytes of a file, or bytes that the model itself holds as text. Nothing
/// of it has been decoded.
struct TextureImage {
  static constexpr uint64_t kToTheEnd = ~uint64_t{0};

  std::string file;                       ///< path; empty: `content` is the image
  uint64_t offset = 0, size = kToTheEnd;  ///< of the image in the file
  Bytes content;
  std::string name;   ///< as the model calls it
  std::string model;  ///< path of the file that refers to it
  bool color = true;  ///< 8 and 16 bits hold sRGB; else numbers
  TexturePick pick = TexturePick::kColor;
};

/// What a store takes of a number that a model gives: none beyond 1e30 either way, 0 for what is none.
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

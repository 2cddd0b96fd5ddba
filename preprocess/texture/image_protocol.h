#pragma once

#include <cstdint>

// What quarry-preprocess and quarry-import-image say to each other through pipes. Messages are uint32 kind,
// uint32 bytes, and the bytes; both run on one machine, from one build.

namespace quarry {

enum class ImageMessage : uint32_t {
  kDecode = 1,  ///< to the helper: uint64 offset, uint64 size, then the path
  kLookAt,      ///< the same, of which kFacts alone is wanted
  kFacts,       ///< from it: ImageFacts as uint32 each
  kRows,        ///< whole rows, from the top; channels together, bytes or floats
  kEnd,         ///< after the last row
  kRefused,     ///< a sentence without the path: the image cannot be read
  kTooLarge,    ///< a sentence: the helper's memory does not do for it
};

inline constexpr uint32_t kImageHeaderBytes = 8;
/// No message is longer.
inline constexpr uint32_t kMostImageMessage = 64u << 20;

/// What is known of an image before its rows. Channels: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha
/// (not multiplied into the colour).
struct ImageFacts {
  uint32_t width = 0, height = 0, channels = 0;
  uint32_t real = 0;     ///< 1: floats; 0: bytes
  uint32_t encoded = 0;  ///< of floats: 1 if they were whole numbers of more than 8 bits, from 0 to 1 here

  uint64_t row_bytes() const { return uint64_t{width} * channels * (real ? 4 : 1); }
};

}  // namespace quarry

#pragma once

#include <cstdint>

// Messages between quarry-preprocess and quarry-import-image through pipes: uint32 kind, uint32 bytes, then
// the bytes. Both run on one machine, from one build.

namespace quarry {

enum class ImageMessage : uint32_t {
  kDecode = 1,  ///< to the helper: uint64 offset, uint64 size, then the path
  kLookAt,      ///< likewise, but only kFacts is answered
  kFacts,       ///< from the helper: ImageFacts, each as uint32
  kRows,        ///< whole rows from the top; channels interleaved, bytes or floats
  kEnd,         ///< after the last row; a sentence about the image's fault, or nothing
  kRefused,     ///< a sentence without the path: the image cannot be read
  kTooLarge,    ///< a sentence: the helper has too little memory
};

inline constexpr uint32_t kImageHeaderBytes = 8;
/// Bytes of a message, at most.
inline constexpr uint32_t kMostImageMessage = 64u << 20;

/// Facts of an image, known before its rows. Channels: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
/// Colours are not multiplied by alpha.
struct ImageFacts {
  uint32_t width = 0, height = 0, channels = 0;
  uint32_t real = 0;     ///< 1: floats; 0: bytes
  uint32_t encoded = 0;  ///< of floats, 1: they were whole numbers of more than 8 bits, scaled to 0..1
  uint32_t in_file = 0;  ///< channels of the file, of layers too; not sent

  uint64_t row_bytes() const { return uint64_t{width} * channels * (real ? 4 : 1); }
};

}  // namespace quarry

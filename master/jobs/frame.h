#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "common/protocol/messages.h"

namespace quarry {

/// One frame being put together: its tiles along a space-filling curve, and the pixels as they come.
/// Not thread-safe.
class Frame {
 public:
  struct Tile {
    uint32_t x, y, width, height;  ///< in the image
  };
  /// Those of a normalized job.
  static std::vector<Tile> TilesOf(const RenderJob& job);

  /// Requires: a normalized job.
  explicit Frame(const RenderJob& job);

  const std::vector<Tile>& tiles() const { return tiles_; }
  uint32_t words_per_pixel() const { return words_; }

  /// Errors: not as many bytes as the tile has.
  Status Put(uint32_t tile, std::span<const std::byte> pixels);

  /// Rows of the crop, words_per_pixel() 32-bit words a pixel.
  const std::vector<uint32_t>& pixels() const { return pixels_; }
  /// Takes them out. Put must not be called after.
  std::vector<uint32_t> TakePixels() { return std::move(pixels_); }

 private:
  uint32_t crop_x_, crop_y_, width_, words_;
  std::vector<Tile> tiles_;
  std::vector<uint32_t> pixels_;
};

}  // namespace quarry

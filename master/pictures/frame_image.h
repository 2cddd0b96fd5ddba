#pragma once

#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "common/scene/view.h"

namespace quarry {

/// The tiles of a frame, kTileSize pixels on a side or less at the crop's edges, along a space-filling
/// (Morton) curve. Requires: `view` is normalized.
std::vector<PixelRect> TilesOf(const View& view);

/// The pixels of one frame, put together from tiles.
/// Units: pixels; words of 32 bits, WordsPerPixel() a pixel. Not thread-safe.
class FrameImage {
 public:
  /// Requires: `view` is normalized.
  explicit FrameImage(const View& view);

  const std::vector<PixelRect>& tiles() const { return tiles_; }

  /// Copies a tile's pixels into the image. Requires: `tile` is less than tiles().size().
  /// Errors: `pixels` has more or fewer bytes than the tile.
  Status Put(uint32_t tile, std::span<const std::byte> pixels);

  /// Rows of the crop.
  const std::vector<uint32_t>& pixels() const { return pixels_; }
  /// Moves the pixels out. Put() must not be called afterwards.
  std::vector<uint32_t> TakePixels() { return std::move(pixels_); }

 private:
  uint32_t crop_x_, crop_y_, width_, words_;
  std::vector<PixelRect> tiles_;
  std::vector<uint32_t> pixels_;
};

}  // namespace quarry

#include "master/pictures/frame_image.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

namespace quarry {
namespace {

/// The bits of x and y interleaved: in Morton order, neighbours in the image are near in the list.
uint64_t Morton(uint32_t x, uint32_t y) {
  uint64_t code = 0;
  for (int bit = 0; bit < 16; ++bit)
    code |= static_cast<uint64_t>(x >> bit & 1) << (2 * bit) | static_cast<uint64_t>(y >> bit & 1)
                                                                   << (2 * bit + 1);
  return code;
}

}  // namespace

std::vector<PixelRect> TilesOf(const View& view) {
  std::vector<PixelRect> tiles;
  for (uint32_t y = 0; y < view.crop.height; y += kTileSize)
    for (uint32_t x = 0; x < view.crop.width; x += kTileSize)
      tiles.push_back({view.crop.x + x, view.crop.y + y, std::min(kTileSize, view.crop.width - x),
                       std::min(kTileSize, view.crop.height - y)});
  std::stable_sort(tiles.begin(), tiles.end(), [&](const PixelRect& a, const PixelRect& b) {
    return Morton((a.x - view.crop.x) / kTileSize, (a.y - view.crop.y) / kTileSize) <
           Morton((b.x - view.crop.x) / kTileSize, (b.y - view.crop.y) / kTileSize);
  });
  return tiles;
}

FrameImage::FrameImage(const View& view)
    : crop_x_(view.crop.x),
      crop_y_(view.crop.y),
      width_(view.crop.width),
      words_(WordsPerPixel(view.aov_mask)),
      tiles_(TilesOf(view)) {
  pixels_.resize(size_t{view.crop.width} * view.crop.height * words_);
}

Status FrameImage::Put(uint32_t index, std::span<const std::byte> pixels) {
  const PixelRect& tile = tiles_[index];
  const size_t row = size_t{tile.width} * words_;
  if (pixels.size() != row * tile.height * 4)
    return Fail(
        fmt::format("a tile has {} bytes of pixels instead of {}", pixels.size(), row * tile.height * 4));
  for (uint32_t y = 0; y < tile.height; ++y) {
    uint32_t* out = pixels_.data() + (size_t{tile.y - crop_y_ + y} * width_ + (tile.x - crop_x_)) * words_;
    std::memcpy(out, pixels.data() + y * row * 4, row * 4);
  }
  return {};
}

}  // namespace quarry

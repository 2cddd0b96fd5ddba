#include "master/jobs/frame_image.h"

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

std::vector<PixelRect> TilesOf(const RenderJob& job) {
  std::vector<PixelRect> tiles;
  for (uint32_t y = 0; y < job.crop_height; y += kTileSize)
    for (uint32_t x = 0; x < job.crop_width; x += kTileSize)
      tiles.push_back({job.crop_x + x, job.crop_y + y, std::min(kTileSize, job.crop_width - x),
                       std::min(kTileSize, job.crop_height - y)});
  std::stable_sort(tiles.begin(), tiles.end(), [&](const PixelRect& a, const PixelRect& b) {
    return Morton((a.x - job.crop_x) / kTileSize, (a.y - job.crop_y) / kTileSize) <
           Morton((b.x - job.crop_x) / kTileSize, (b.y - job.crop_y) / kTileSize);
  });
  return tiles;
}

FrameImage::FrameImage(const RenderJob& job)
    : crop_x_(job.crop_x),
      crop_y_(job.crop_y),
      width_(job.crop_width),
      words_(WordsPerPixel(job.aov_mask)),
      tiles_(TilesOf(job)) {
  pixels_.resize(size_t{job.crop_width} * job.crop_height * words_);
}

Status FrameImage::Put(uint32_t index, std::span<const std::byte> pixels) {
  const PixelRect& tile = tiles_[index];
  const size_t row = size_t{tile.width} * words_;
  if (pixels.size() != row * tile.height * 4)
    return Fail(fmt::format("a tile came with {} bytes of pixels instead of {}", pixels.size(),
                            row * tile.height * 4));
  for (uint32_t y = 0; y < tile.height; ++y) {
    uint32_t* out = pixels_.data() + (size_t{tile.y - crop_y_ + y} * width_ + (tile.x - crop_x_)) * words_;
    std::memcpy(out, pixels.data() + y * row * 4, row * 4);
  }
  return {};
}

}  // namespace quarry

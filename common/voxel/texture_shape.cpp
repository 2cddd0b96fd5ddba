#include "common/voxel/texture_shape.h"

#include <algorithm>

#include "common/base/check.h"

namespace quarry {

Status CheckTexelLayout(const TexelLayout& layout) {
  if (layout.width == 0 || layout.height == 0 || layout.width > kMaxTextureSide ||
      layout.height > kMaxTextureSide || layout.channels == 0 || layout.channels > 4 ||
      static_cast<uint32_t>(layout.format) >= kTexelFormats)
    return Fail("an invalid size or kind of texels");
  return {};
}

TextureShape::TextureShape(uint32_t width, uint32_t height) {
  QUARRY_CHECK(width - 1 < kMaxTextureSide && height - 1 < kMaxTextureSide);
  for (uint32_t w = width, h = height;; w = std::max(w / 2, 1u), h = std::max(h / 2, 1u)) {
    const bool parted = w > kPageSide || h > kPageSide;
    const uint32_t columns = (w + kPageSide - 1) / kPageSide, rows = (h + kPageSide - 1) / kPageSide;
    levels_.push_back({w, h, columns, rows, pages_});
    if (parted) {
      pages_ += columns * rows;
      ++tail_;
    }
    if (w == 1 && h == 1) break;
  }
  ++pages_;
}

uint32_t TextureShape::PageOf(uint32_t level, uint32_t column, uint32_t row) const {
  return levels_[level].first_page + row * levels_[level].columns + column;
}

TextureShape::Part TextureShape::PartOf(uint32_t page) const {
  uint32_t level = tail_;
  while (level > 0 && page < levels_[level].first_page) --level;
  const Level& l = levels_[level];
  const uint32_t index = page - l.first_page;
  const uint32_t x = index % l.columns * kPageSide, y = index / l.columns * kPageSide;
  return {level, x, y, std::min(kPageSide, l.width - x), std::min(kPageSide, l.height - y)};
}

uint32_t TextureShape::TexelsOf(uint32_t page) const {
  if (page + 1 == pages_) return TailOffset(static_cast<uint32_t>(levels_.size()));
  const Part part = PartOf(page);
  return part.width * part.height;
}

uint32_t TextureShape::TailOffset(uint32_t level) const {
  uint32_t texels = 0;
  for (uint32_t l = tail_; l < level; ++l) texels += levels_[l].width * levels_[l].height;
  return texels;
}

}  // namespace quarry

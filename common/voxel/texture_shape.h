#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// How a texel is stored: channels one after the other.
enum class TexelFormat : uint32_t {
  kSrgb8,    ///< a byte a channel, sRGB-encoded; alpha linear
  kLinear8,  ///< a byte a channel
  kHalf,     ///< a half float a channel, linear
};
inline constexpr uint32_t kTexelFormats = 3;

/// Side of a page in texels; FORMAT.md says why.
inline constexpr uint32_t kPageSide = 64;
inline constexpr uint32_t kMaxTextureSide = 32768;
inline constexpr uint32_t kMaxTextures = 65536;
/// Over all textures of a scene: numbers of pages are 32 bits with room to spare.
inline constexpr uint32_t kMaxPages = 1u << 30;

/// What is known of a texture's pixels. Channels: 1 grey, 2 grey and alpha, 3 RGB, 4 RGB and alpha.
struct TexelLayout {
  uint32_t width = 0, height = 0, channels = 0;
  TexelFormat format = TexelFormat::kLinear8;

  uint32_t channel_bytes() const { return format == TexelFormat::kHalf ? 2 : 1; }
  uint32_t texel_bytes() const { return channels * channel_bytes(); }
  bool has_alpha() const { return channels == 2 || channels == 4; }
  bool operator==(const TexelLayout&) const = default;
};
/// Errors: a side, a number of channels or a format that cannot be.
Status CheckTexelLayout(const TexelLayout& layout);

/// The levels of a texture and the pages they lie in. Level 0 is the image; each further one has half the
/// sides, rounded down, 1 at least; the last is one texel. Levels are parted into pages of kPageSide squared
/// texels, those at the right and lower border smaller; the levels that need no parting, the *tail*, lie all
/// in the last page, one after the other. Pages are numbered level by level, row by row.
class TextureShape {
 public:
  struct Level {
    uint32_t width, height;
    uint32_t columns, rows;  ///< of pages; in the tail 1
    uint32_t first_page;
  };
  /// What a page holds: a part of one level; of the tail's page its first level, whole.
  struct Part {
    uint32_t level, x, y, width, height;
  };

  /// Requires: 1 <= width, height <= kMaxTextureSide.
  TextureShape(uint32_t width, uint32_t height);

  const std::vector<Level>& levels() const { return levels_; }
  uint32_t tail() const { return tail_; }  ///< the first level of the tail
  uint32_t pages() const { return pages_; }
  uint32_t PageOf(uint32_t level, uint32_t column, uint32_t row) const;
  Part PartOf(uint32_t page) const;
  uint32_t TexelsOf(uint32_t page) const;
  /// How many texels of the tail's page come before those of a level of the tail.
  uint32_t TailOffset(uint32_t level) const;

 private:
  std::vector<Level> levels_;
  uint32_t tail_ = 0, pages_ = 0;
};

}  // namespace quarry

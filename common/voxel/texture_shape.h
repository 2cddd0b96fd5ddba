#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"

namespace quarry {

/// Storage of a texel: its channels one after the other.
enum class TexelFormat : uint32_t {
  kSrgb8,    ///< one byte per channel, sRGB-encoded; alpha is linear
  kLinear8,  ///< one byte per channel, linear
  kHalf,     ///< one half float per channel, linear
};
inline constexpr uint32_t kTexelFormats = 3;

/// Side of a page in texels. Chosen by tests/bench/history/store_format.md, 2026-11-22.
inline constexpr uint32_t kPageSide = 64;
/// Limits against damaged stores: texels per side, textures per scene.
inline constexpr uint32_t kMaxTextureSide = 32768;
inline constexpr uint32_t kMaxTextures = 65536;
/// Limit of pages over all textures of a scene; page numbers are 32 bits.
inline constexpr uint32_t kMaxPages = 1u << 30;

/// The format of a texture's texels. Units: width and height in texels.
/// Channels: 1 grey; 2 grey and alpha; 3 RGB; 4 RGB and alpha.
struct TexelLayout {
  uint32_t width = 0, height = 0, channels = 0;
  TexelFormat format = TexelFormat::kLinear8;

  uint32_t channel_bytes() const { return format == TexelFormat::kHalf ? 2 : 1; }
  uint32_t texel_bytes() const { return channels * channel_bytes(); }
  bool has_alpha() const { return channels == 2 || channels == 4; }
  bool operator==(const TexelLayout&) const = default;
};
/// Errors: an impossible side, number of channels or format.
Status CheckTexelLayout(const TexelLayout& layout);

/// The levels of a texture and the pages that hold them. Level 0 is the image; each further level has half
/// the sides, rounded down but at least 1; the last level is one texel. A level larger than a page is cut
/// into pages of kPageSide x kPageSide texels, smaller at the right and lower border. The levels that fit one
/// page are the *tail*: all lie in the last page, one after the other. Pages are numbered level by level, row
/// by row. Thread-safe.
/// Units: texels.
class TextureShape {
 public:
  struct Level {
    uint32_t width, height;
    uint32_t columns, rows;  ///< pages per row, rows of pages; 1 in the tail
    uint32_t first_page;
  };
  /// The rectangle of one level that a page holds. For the tail's page: its first level, whole.
  struct Part {
    uint32_t level, x, y, width, height;
  };

  /// Requires: 1 <= width, height <= kMaxTextureSide.
  TextureShape(uint32_t width, uint32_t height);

  const std::vector<Level>& levels() const { return levels_; }
  uint32_t tail() const { return tail_; }  ///< the first level of the tail
  uint32_t pages() const { return pages_; }
  /// The page of a level at a column and row of pages. Requires: they exist.
  uint32_t PageOf(uint32_t level, uint32_t column, uint32_t row) const;
  /// The rectangle of texels that a page holds. Requires: page < pages().
  Part PartOf(uint32_t page) const;
  /// The number of texels in a page. Requires: page < pages().
  uint32_t TexelsOf(uint32_t page) const;
  /// The number of texels in the tail's page before `level`. Requires: tail() <= level <= levels().size().
  uint32_t TailOffset(uint32_t level) const;

 private:
  std::vector<Level> levels_;
  uint32_t tail_ = 0, pages_ = 0;
};

}  // namespace quarry

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <glm/vec4.hpp>
#include <vector>

#include "common/math/half.h"
#include "common/scene/material.h"
#include "common/voxel/block_key.h"
#include "common/voxel/catalog.h"

// Filtered lookups of textures whose pages may be missing. A lookup is a sum over a few texels in a fixed
// order. It keeps the sum and its number of texels, so that it can wait for one page at a time.

namespace quarry {

/// The levels of a texture, with the blocks that hold them. Immutable, so thread-safe.
struct TexturePyramid {
  struct Level {
    uint32_t width, height;    ///< texels
    uint32_t columns;          ///< pages in a row; 0: the level lies in the tail's page
    uint32_t first_page;       ///< as BlockKey::Page() counts pages
    uint32_t tail_offset = 0;  ///< texels before it in the tail's page
  };
  TexelLayout layout;
  std::vector<Level> levels;

  TexturePyramid(const Catalog& catalog, uint32_t texture);
};

/// Texels of one level around a point: columns x[0], x[1] and rows y[0], y[1], with the weights 1 - f and f.
struct BilinearTexels {
  uint32_t level;
  float share;  ///< of the level in the sum
  uint32_t x[2], y[2];
  float fx, fy;
};

/// The texels of a lookup, of one level or two.
struct FilterFootprint {
  BilinearTexels levels[2];
  uint32_t count;

  uint32_t texels() const { return 4 * count; }
};

/// The two texels of `size` around a position along one axis, and the weight of the second. Selects instead
/// of branching, so that loops over it become vector instructions.
template <TextureWrap kWrap>
inline void TexelsAlong(float position, uint32_t size, uint32_t& first, uint32_t& second, float& weight) {
  float p = std::fabs(position) <= 0x1p20f ? position : 0.0f;
  if constexpr (kWrap == TextureWrap::kRepeat) {
    p -= std::floor(p);
  } else if constexpr (kWrap == TextureWrap::kMirror) {
    p -= 2 * std::floor(p * 0.5f);
    p = p > 1 ? 2 - p : p;
  } else {
    p = p > 0 ? p : 0.0f;
    p = p < 1 ? p : 1.0f;
  }
  const auto last = static_cast<int32_t>(size) - 1;
  const float x = p * static_cast<float>(static_cast<int32_t>(size)) - 0.5f, whole = std::floor(x);
  weight = x - whole;
  const auto i = static_cast<int32_t>(whole);
  constexpr bool kAround = kWrap == TextureWrap::kRepeat;
  const int32_t low = kAround ? last : 0, high = kAround ? 0 : last;
  first = static_cast<uint32_t>(i < 0 ? low : i < last ? i : last);
  second = static_cast<uint32_t>(i < last ? i + 1 : high);
}

/// TexelsAlong() for a wrap that is known at run time only.
inline void TexelsAlong(TextureWrap wrap, float position, uint32_t size, uint32_t (&texels)[2],
                        float& weight) {
  switch (wrap) {
    case TextureWrap::kRepeat:
      return TexelsAlong<TextureWrap::kRepeat>(position, size, texels[0], texels[1], weight);
    case TextureWrap::kClamp:
      return TexelsAlong<TextureWrap::kClamp>(position, size, texels[0], texels[1], weight);
    case TextureWrap::kMirror:
      return TexelsAlong<TextureWrap::kMirror>(position, size, texels[0], texels[1], weight);
  }
}

/// The texels of level 0 around a point of the image, for lookups that must not be blurred.
inline FilterFootprint BaseFootprint(const TexturePyramid& pyramid, const TextureBinding& binding, float u,
                                     float v) {
  const auto& a = binding.transform;
  FilterFootprint f{};
  f.count = 1;
  BilinearTexels& t = f.levels[0];
  t.share = 1;
  TexelsAlong(binding.wrap_s, a[0] * u + a[1] * v + a[2], pyramid.levels[0].width, t.x, t.fx);
  TexelsAlong(binding.wrap_t, a[3] * u + a[4] * v + a[5], pyramid.levels[0].height, t.y, t.fy);
  return f;
}

/// The finer of the two levels around `lod`, and the weight of the other level; the weight is 0 where there
/// is only one level.
inline void LevelsAt(float lod, uint32_t levels, uint32_t& level, float& share) {
  const auto last = static_cast<float>(static_cast<int32_t>(levels) - 1);
  const float above = lod > 0 ? lod : 0.0f, at = above < last ? above : last, whole = std::floor(at);
  level = static_cast<uint32_t>(static_cast<int32_t>(whole));
  share = at - whole;
}

/// The place of a texel: its page, and its index there.
struct TexelPlace {
  BlockKey page;
  uint32_t index;
};
inline TexelPlace PlaceOf(const TexturePyramid& pyramid, uint32_t level, uint32_t x, uint32_t y) {
  const TexturePyramid::Level& l = pyramid.levels[level];
  if (l.columns == 0) return {BlockKey::Page(l.first_page), l.tail_offset + y * l.width + x};
  const uint32_t column = x / kPageSide, row = y / kPageSide;
  const uint32_t width = std::min(kPageSide, l.width - column * kPageSide);
  return {BlockKey::Page(l.first_page + row * l.columns + column), y % kPageSide * width + x % kPageSide};
}

/// A lookup under way. Begins with zeros.
struct TextureLookup {
  uint32_t texels = 0;  ///< that are in the sum
  glm::vec4 sum{0};
};

/// The quantity of a lookup: the texture's value, or the slope of its first channel, with the derivatives by
/// s and t in the sum's x and y.
enum class LookupKind { kValue, kSlope };

/// Linear values of the codes of a byte.
struct TexelCodes {
  float srgb[256], linear[256];
  TexelCodes();
  /// Made at the first call: nothing of this library runs before a program asks. Thread-safe.
  static const TexelCodes& Get();
};

/// Reads texels of one format: linear colours, grey in all three channels, alpha 1 where there is none.
template <uint32_t kChannels, bool kHalf>
struct TexelReader {
  const float* linear = TexelCodes::Get().linear;
  const float* codes;  ///< of colours

  explicit TexelReader(const TexelLayout& layout)
      : codes(layout.format == TexelFormat::kSrgb8 ? TexelCodes::Get().srgb : linear) {}
  glm::vec4 operator()(const std::byte* page, uint32_t index) const {
    float v[kChannels];
    const std::byte* at = page + size_t{kHalf ? 2u : 1u} * kChannels * index;
    constexpr uint32_t kColors = kChannels % 2 == 0 ? kChannels - 1 : kChannels;
    for (uint32_t c = 0; c < kChannels; ++c) {
      if constexpr (kHalf) {
        uint16_t half = 0;
        std::memcpy(&half, at + size_t{2} * c, sizeof half);
        v[c] = HalfToFloat(half);
      } else {
        v[c] = (c < kColors ? codes : linear)[static_cast<size_t>(at[c])];
      }
    }
    const float alpha = kColors != kChannels ? v[kChannels - 1] : 1.0f;
    return {v[0], v[kChannels < 3 ? 0 : 1], v[kChannels < 3 ? 0 : 2], alpha};
  }
};

/// Calls body(reader) with the TexelReader of the format. Returns: what it returns.
template <class Body>
inline auto WithReader(const TexelLayout& layout, Body&& body) {
  const auto with = [&]<uint32_t kChannels>() {
    return layout.format == TexelFormat::kHalf ? body(TexelReader<kChannels, true>(layout))
                                               : body(TexelReader<kChannels, false>(layout));
  };
  switch (layout.channels) {
    case 1:
      return with.template operator()<1>();
    case 2:
      return with.template operator()<2>();
    case 3:
      return with.template operator()<3>();
    default:
      return with.template operator()<4>();
  }
}

/// One texel of a page. It finds the format out: for single texels.
inline glm::vec4 TexelAt(const TexelLayout& layout, const std::byte* page, uint32_t index) {
  return WithReader(layout, [&](const auto& texel_at) { return texel_at(page, index); });
}

/// Adds a texel, number `n` of its level, to the sum.
template <LookupKind kKind>
inline void AddTexel(const TexturePyramid::Level& level, const BilinearTexels& f, uint32_t n,
                     const glm::vec4& texel, TextureLookup& lookup) {
  const bool right = (n & 1) != 0, lower = (n & 2) != 0;
  const float across = right ? f.fx : 1 - f.fx, down = lower ? f.fy : 1 - f.fy;
  if constexpr (kKind == LookupKind::kValue) {
    lookup.sum += texel * (f.share * across * down);
  } else {
    const float height = f.share * texel.x;
    lookup.sum.x += (right ? height : -height) * down * static_cast<float>(level.width);
    lookup.sum.y += (lower ? height : -height) * across * static_cast<float>(level.height);
  }
}

/// GoOnLookup() for one format.
template <LookupKind kKind, class Reader, class Find>
inline bool GoOnWith(const Reader& texel_at, const TexturePyramid& pyramid, const FilterFootprint& footprint,
                     Find&& find, TextureLookup& lookup, BlockKey& missing) {
  while (lookup.texels < footprint.texels()) {
    const BilinearTexels& f = footprint.levels[lookup.texels / 4];
    const TexturePyramid::Level& level = pyramid.levels[f.level];
    uint32_t n = lookup.texels % 4;
    const TexelPlace first = PlaceOf(pyramid, f.level, f.x[n & 1], f.y[n >> 1]);
    const std::byte* page = find(first.page);
    if (!page) {
      missing = first.page;
      return false;
    }
    // Usually all texels lie in the page of the first.
    for (; n < 4; ++n, ++lookup.texels) {
      const TexelPlace place = PlaceOf(pyramid, f.level, f.x[n & 1], f.y[n >> 1]);
      if (place.page != first.page) break;
      AddTexel<kKind>(level, f, n, texel_at(page, place.index), lookup);
    }
  }
  return true;
}

/// Adds texels to `lookup` until it is complete, or until a texel's page is missing. `find(BlockKey)` gives
/// the texels of a page, or null. Returns: whether it is complete; else `missing` is the page.
template <LookupKind kKind, class Find>
inline bool GoOnLookup(const TexturePyramid& pyramid, const FilterFootprint& footprint, Find&& find,
                       TextureLookup& lookup, BlockKey& missing) {
  return WithReader(pyramid.layout, [&](const auto& texel_at) {
    return GoOnWith<kKind>(texel_at, pyramid, footprint, find, lookup, missing);
  });
}

}  // namespace quarry

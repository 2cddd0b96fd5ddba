#include "common/voxel/texture_page.h"

#include <lz4.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>
#include <type_traits>
#include <vector>

#include "common/base/check.h"

namespace quarry {
namespace {

/// A rectangle of texels in a page; `first` is the index of its first texel.
struct Block {
  uint32_t width, height;
  size_t first;
};

std::vector<Block> BlocksOf(const TextureShape& shape, uint32_t page) {
  if (page + 1 != shape.pages()) {
    const TextureShape::Part part = shape.PartOf(page);
    return {{part.width, part.height, 0}};
  }
  std::vector<Block> blocks;
  for (auto l = shape.tail(); l < shape.levels().size(); ++l)
    blocks.push_back({shape.levels()[l].width, shape.levels()[l].height, shape.TailOffset(l)});
  return blocks;
}

/// The value among left, above and corner (above left) that is nearest to left + above - corner.
/// Source: Paeth, Image file compression made easy, in Graphics Gems II, 1991.
int Nearest(int left, int above, int corner) {
  const int a = std::abs(above - corner), b = std::abs(left - corner),
            c = std::abs(left + above - 2 * corner);
  return a <= b && a <= c ? left : b <= c ? above : corner;
}

/// The prediction for texel (x, y) of a channel of `block` from earlier neighbours.
template <class Sample>
int Foretold(const Sample* values, const Block& block, uint32_t x, uint32_t y) {
  const size_t at = block.first + size_t{y} * block.width + x;
  if (x == 0) return y == 0 ? 0 : values[at - block.width];
  if (y == 0) return values[at - 1];
  return Nearest(values[at - 1], values[at - block.width], values[at - block.width - 1]);
}

/// Maps halves to integers of the same order, so that near values have small differences.
uint16_t Ordered(uint16_t half) { return half & 0x8000u ? ~half : half | 0x8000u; }
uint16_t Unordered(uint16_t value) { return value & 0x8000u ? value & 0x7FFFu : ~value; }

/// Maps 0, -1, 1, -2, ... to 0, 1, 2, 3, ...
uint16_t Zigzag(uint16_t v) { return static_cast<uint16_t>(v << 1 ^ (v & 0x8000u ? 0xFFFFu : 0)); }
uint16_t Unzigzag(uint16_t v) { return static_cast<uint16_t>(v >> 1 ^ (v & 1 ? 0xFFFFu : 0)); }

/// Splits `texels` into one array per channel; halves become ordered integers.
template <class Sample, uint32_t kChannels>
void Split(std::span<const std::byte> texels, size_t count, Sample* planes) {
  const std::byte* in = texels.data();
  for (size_t i = 0; i < count; ++i)
    for (uint32_t c = 0; c < kChannels; ++c) {
      Sample value;
      std::memcpy(&value, in + (i * kChannels + c) * sizeof value, sizeof value);
      if constexpr (sizeof(Sample) == 2) value = Ordered(value);
      planes[c * count + i] = value;
    }
}

template <class Sample>
std::vector<Sample> Channels(std::span<const std::byte> texels, uint32_t channels) {
  const size_t count = texels.size() / (sizeof(Sample) * channels);
  std::vector<Sample> planes(count * channels);
  constexpr decltype(&Split<Sample, 1>) kSplit[] = {Split<Sample, 1>, Split<Sample, 2>, Split<Sample, 3>,
                                                    Split<Sample, 4>};
  kSplit[channels - 1](texels, count, planes.data());
  return planes;
}

/// The differences between a row's values, from the second on, and their predictions. As Nearest(), but
/// without branches, so that compilers make vector instructions of it.
template <class Sample>
void SubtractRow(const Sample* __restrict row, const Sample* __restrict above, size_t width,
                 Sample* __restrict out) {
  using Wide = std::conditional_t<sizeof(Sample) == 1, int16_t, int32_t>;
  const auto magnitude = [](Wide x) { return static_cast<Wide>(x < 0 ? -x : x); };
  const auto either = [](bool first, Wide a, Wide b) {
    const auto mask = static_cast<Wide>(-static_cast<Wide>(first));
    return static_cast<Wide>((a & mask) | (b & ~mask));
  };
  for (size_t x = 1; x < width; ++x) {
    const Wide l = row[x - 1], a = above[x], c = above[x - 1];
    const Wide of_left = magnitude(static_cast<Wide>(a - c)), of_above = magnitude(static_cast<Wide>(l - c)),
               of_corner = magnitude(static_cast<Wide>(l + a - 2 * c));
    const bool is_left = (of_left <= of_above) & (of_left <= of_corner);
    out[x] = static_cast<Sample>(row[x] - either(is_left, l, either(of_above <= of_corner, a, c)));
  }
}

/// The differences of a channel of `block` from Foretold().
template <class Sample>
void Subtract(const Sample* values, const Block& block, Sample* out) {
  const size_t width = block.width, height = block.height;
  const Sample* row = values + block.first;
  Sample* to = out + block.first;
  to[0] = row[0];
  for (size_t x = 1; x < width; ++x) to[x] = static_cast<Sample>(row[x] - row[x - 1]);
  for (size_t y = 1; y < height; ++y) {
    row += width;
    to += width;
    to[0] = static_cast<Sample>(row[0] - row[0 - width]);
    SubtractRow(row, row - width, width, to);
  }
}

template <class Sample>
void PutSample(Sample difference, size_t at, size_t all, std::byte* out) {
  if constexpr (sizeof(Sample) == 2) {
    difference = Zigzag(difference);
    out[all + at] = static_cast<std::byte>(difference >> 8);  // all high bytes follow all low bytes
  }
  out[at] = static_cast<std::byte>(difference);
}

template <class Sample>
Sample TakeSample(std::span<const std::byte> streams, size_t at, size_t all) {
  if constexpr (sizeof(Sample) == 2)
    return Unzigzag(static_cast<Sample>(static_cast<Sample>(streams[at]) |
                                        static_cast<Sample>(static_cast<Sample>(streams[all + at]) << 8)));
  return static_cast<Sample>(streams[at]);
}

template <class Sample>
Bytes Encode(const std::vector<Block>& blocks, uint32_t channels, std::span<const std::byte> texels) {
  const std::vector<Sample> planes = Channels<Sample>(texels, channels);
  const size_t all = planes.size(), count = all / channels;
  std::vector<Sample> differences(all);
  for (uint32_t c = 0; c < channels; ++c)
    for (const Block& block : blocks) Subtract(&planes[c * count], block, &differences[c * count]);
  Bytes out(all * sizeof(Sample));
  // The channels' differences resemble each other, so the previous channel's is subtracted.
  const auto put = [all, to = out.data(), from = differences.data()](size_t begin, size_t end, size_t back) {
    for (size_t i = begin; i < end; ++i)
      PutSample(back == 0 ? from[i] : static_cast<Sample>(from[i] - from[i - back]), i, all, to);
  };
  put(0, count, 0);
  put(count, all, count);
  return out;
}

template <class Sample>
void Decode(const std::vector<Block>& blocks, uint32_t channels, std::span<const std::byte> streams,
            std::span<std::byte> texels) {
  const size_t all = streams.size() / sizeof(Sample), count = all / channels;
  std::vector<Sample> differences(all), values(count);
  for (size_t i = 0; i < all; ++i)
    differences[i] = static_cast<Sample>(TakeSample<Sample>(streams, i, all) +
                                         (i < count ? Sample{0} : differences[i - count]));
  for (uint32_t c = 0; c < channels; ++c) {
    for (const Block& block : blocks)
      for (uint32_t y = 0; y < block.height; ++y)
        for (uint32_t x = 0; x < block.width; ++x) {
          const size_t at = block.first + size_t{y} * block.width + x;
          values[at] =
              static_cast<Sample>(differences[c * count + at] + Foretold(values.data(), block, x, y));
        }
    for (size_t i = 0; i < count; ++i) {
      Sample value = values[i];
      if constexpr (sizeof(Sample) == 2) value = Unordered(value);
      std::memcpy(&texels[(i * channels + c) * sizeof value], &value, sizeof value);
    }
  }
}

}  // namespace

Bytes EncodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                 std::span<const std::byte> texels) {
  QUARRY_CHECK(page < shape.pages() && texels.size() == shape.TexelsOf(page) * layout.texel_bytes());
  const std::vector<Block> blocks = BlocksOf(shape, page);
  return layout.format == TexelFormat::kHalf ? Encode<uint16_t>(blocks, layout.channels, texels)
                                             : Encode<uint8_t>(blocks, layout.channels, texels);
}

Status DecodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                  std::span<const std::byte> stored, std::span<std::byte> texels) {
  QUARRY_CHECK_LT(page, shape.pages());
  const size_t size = size_t{shape.TexelsOf(page)} * layout.texel_bytes();
  QUARRY_CHECK_EQ(texels.size(), size);
  ByteReader in(stored);
  if (in.Get<uint32_t>() != size) return Fail("texture page: another number of bytes than its texels take");
  const auto packed = in.GetSpan(in.remaining());
  Bytes streams(size);
  if (packed.size() == size) {
    std::ranges::copy(packed, streams.begin());
  } else {
    const int got = LZ4_decompress_safe(
        reinterpret_cast<const char*>(packed.data()), reinterpret_cast<char*>(streams.data()),
        static_cast<int>(std::min<size_t>(packed.size(), 1u << 30)), static_cast<int>(size));
    if (got < 0 || static_cast<size_t>(got) != size) return Fail("texture page: LZ4 cannot decompress it");
  }
  const std::vector<Block> blocks = BlocksOf(shape, page);
  if (layout.format == TexelFormat::kHalf)
    Decode<uint16_t>(blocks, layout.channels, streams, texels);
  else
    Decode<uint8_t>(blocks, layout.channels, streams, texels);
  return {};
}

Result<Bytes> DecodePage(const TextureShape& shape, const TexelLayout& layout, uint32_t page,
                         std::span<const std::byte> stored) {
  Bytes texels(size_t{shape.TexelsOf(page)} * layout.texel_bytes());
  QUARRY_TRY(DecodePage(shape, layout, page, stored, texels));
  return texels;
}

}  // namespace quarry

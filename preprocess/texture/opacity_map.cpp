#include "preprocess/texture/opacity_map.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "common/base/check.h"
#include "common/math/elementary.h"
#include "common/math/half.h"

namespace quarry {
namespace {

constexpr size_t kCachedTiles = 256;  // a power of two

std::atomic<uint64_t> next_id{1};

/// The bits [begin, end] of a word.
uint64_t Bits(uint32_t begin, uint32_t end) { return (~uint64_t{0} >> (63 - (end - begin))) << begin; }

bool Has(uint64_t word, uint64_t bits) { return (word & bits) == bits; }

}  // namespace

OpacityTiles::OpacityTiles(std::unique_ptr<TemporaryFile> place, OutputFile out)
    : id_(next_id++),
      place_(std::move(place)),
      out_(std::make_unique<OutputFile>(std::move(out))),
      failed_(std::make_unique<std::atomic<bool>>(false)) {}

Result<OpacityTiles> OpacityTiles::Create(const std::string& path) {
  auto place = std::make_unique<TemporaryFile>(path);
  QUARRY_ASSIGN(OutputFile out, OutputFile::Continue(path, path, 0));
  return OpacityTiles(std::move(place), std::move(out));
}

Result<uint32_t> OpacityTiles::Add(const OpacityTile& tile) {
  const auto number = static_cast<uint32_t>(out_->size() / sizeof tile);
  QUARRY_TRY(out_->Write(&tile, sizeof tile));
  return number;
}

Status OpacityTiles::EndWriting() {
  QUARRY_TRY(out_->Flush());
  out_.reset();
  QUARRY_ASSIGN(in_, InputFile::Open(place_->path()));
  return {};
}

const OpacityTile& OpacityTiles::Get(uint32_t tile) const {
  struct Cached {
    uint64_t id = 0;
    uint32_t tile = 0;
    OpacityTile content;
  };
  thread_local std::vector<Cached> cache(kCachedTiles);
  Cached& entry = cache[tile % kCachedTiles];
  if (entry.id == id_ && entry.tile == tile) return entry.content;
  const auto bytes = std::as_writable_bytes(std::span(&entry.content, 1));
  entry.id = id_;
  entry.tile = tile;
  if (!in_->ReadAt(uint64_t{tile} * sizeof(OpacityTile), bytes)) {
    *failed_ = true;
    entry.id = 0;
    entry.content = {};
  }
  return entry.content;
}

OpacityMap::OpacityMap(const TexelLayout& layout, const OpacityRule& rule)
    : layout_(layout), rule_(rule), columns_((layout.width + kPageSide - 1) / kPageSide), strip_(columns_) {
  slots_.reserve(size_t{columns_} * ((layout.height + kPageSide - 1) / kPageSide));
  const bool encoded = layout.format == TexelFormat::kSrgb8 && !layout.has_alpha();
  for (size_t code = 0; code < codes_.size(); ++code) {
    const float value = static_cast<float>(code) / 255;
    codes_[code] =
        rule.StatesOf(encoded ? static_cast<float>(DecodeSrgb(static_cast<double>(code) / 255.0)) : value);
  }
  for (OpacityTile& tile : strip_) {
    tile.opaque.fill(~uint64_t{0});
    tile.transparent.fill(~uint64_t{0});
  }
}

Status OpacityMap::AddRow(std::span<const std::byte> texels, OpacityTiles& tiles) {
  const uint32_t size = layout_.texel_bytes(), last = size - layout_.channel_bytes(), y = row_ % kPageSide;
  QUARRY_CHECK(texels.size() == size_t{layout_.width} * size && row_ < layout_.height);
  for (uint32_t x = 0; x < layout_.width; ++x) {
    const std::byte* at = &texels[size_t{x} * size + last];
    TexelStates states;
    if (layout_.format == TexelFormat::kHalf) {
      uint16_t half;
      std::memcpy(&half, at, sizeof half);
      states = rule_.StatesOf(HalfToFloat(half));
    } else {
      states = codes_[static_cast<size_t>(*at)];
    }
    const uint64_t bit = uint64_t{1} << (x % kPageSide);
    OpacityTile& tile = strip_[x / kPageSide];
    if (!states.opaque) tile.opaque[y] &= ~bit;
    if (!states.transparent) tile.transparent[y] &= ~bit;
  }
  ++row_;
  return row_ % kPageSide == 0 || row_ == layout_.height ? EndStrip(tiles) : Status{};
}

Status OpacityMap::EndStrip(OpacityTiles& tiles) {
  for (OpacityTile& tile : strip_) {
    TexelStates states;
    for (uint32_t y = 0; y < kPageSide; ++y)
      states.Meet({Has(tile.opaque[y], ~uint64_t{0}), Has(tile.transparent[y], ~uint64_t{0})});
    whole_.Meet(states);
    if (states.mixed()) {
      QUARRY_ASSIGN(const uint32_t number, tiles.Add(tile));
      slots_.push_back(number);
    } else {
      slots_.push_back(states.opaque ? kOpaque : kTransparent);
    }
    tile.opaque.fill(~uint64_t{0});
    tile.transparent.fill(~uint64_t{0});
  }
  return {};
}

TexelStates OpacityMap::StatesIn(uint32_t row, uint32_t begin, uint32_t end,
                                 const OpacityTiles& tiles) const {
  TexelStates states;
  for (uint32_t column = begin / kPageSide; column <= end / kPageSide && !states.mixed(); ++column) {
    const uint32_t slot = slots_[size_t{row / kPageSide} * columns_ + column];
    if (slot >= kTransparent) {
      states.Meet({slot == kOpaque, slot == kTransparent});
      continue;
    }
    const uint32_t first = column * kPageSide;
    const uint64_t bits = Bits(std::max(begin, first) - first, std::min(end - first, kPageSide - 1));
    const OpacityTile& tile = tiles.Get(slot);
    states.Meet({Has(tile.opaque[row % kPageSide], bits), Has(tile.transparent[row % kPageSide], bits)});
  }
  return states;
}

}  // namespace quarry

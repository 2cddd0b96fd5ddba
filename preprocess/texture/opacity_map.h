#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"
#include "common/scene/material.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/spill/temporary_file.h"

namespace quarry {

/// The states that all texels of a set share.
struct TexelStates {
  bool opaque = true, transparent = true;

  bool mixed() const { return !opaque && !transparent; }
  void Meet(TexelStates other) {
    opaque = opaque && other.opaque;
    transparent = transparent && other.transparent;
  }
};

/// The rule by which a texel's opacity is judged, times `factor`: below `cutoff` transparent, else opaque. A
/// cutoff of 0 is none: 0 or less is transparent, 1 or more opaque. See TextureBinding. A texel so near the
/// cutoff that shading's rounding decides is neither (common/engine/surfaces/see_through/cut_outs.cpp).
struct OpacityRule {
  static constexpr float kRounding = 2e-6f;
  float factor = 1, cutoff = 0;

  TexelStates StatesOf(float texel) const {
    const float opacity = factor * texel;
    if (cutoff != 0) return {opacity >= cutoff, opacity + kRounding < cutoff};
    return {opacity >= 1, opacity <= 0};
  }
  auto operator<=>(const OpacityRule&) const = default;
};

/// Texels of kPageSide rows and columns, two bits each: a word a row, texel x at bit x. Both are set beyond
/// the image.
struct OpacityTile {
  std::array<uint64_t, kPageSide> opaque, transparent;
};
static_assert(sizeof(OpacityTile) == 1024);

/// Tiles in a temporary file, read through a cache of 256 KiB a thread. Thread-safe after EndWriting().
class OpacityTiles {
 public:
  /// Errors, here and below: as OutputFile.
  static Result<OpacityTiles> Create(const std::string& path);
  /// Appends a tile; returns its number. Errors: disk full.
  Result<uint32_t> Add(const OpacityTile& tile);
  Status EndWriting();
  /// A tile, valid until the thread's next call. A read error gives a tile of mixed texels and makes failed()
  /// true.
  const OpacityTile& Get(uint32_t tile) const;
  bool failed() const { return *failed_; }

 private:
  OpacityTiles(std::unique_ptr<TemporaryFile> place, OutputFile out);
  uint64_t id_;  ///< of this object, for the caches
  std::unique_ptr<TemporaryFile> place_;
  std::unique_ptr<OutputFile> out_;
  std::optional<InputFile> in_;
  std::unique_ptr<std::atomic<bool>> failed_;
};

/// The opaque and the transparent texels of an image, by one rule. Memory: 4 bytes a tile; tiles that are the
/// same all over are kept nowhere else. Units: texels. Thread-safe once built.
class OpacityMap {
 public:
  OpacityMap(const TexelLayout& layout, const OpacityRule& rule);

  /// Adds the next row, as stored; its last channel is opacity. Errors: disk full.
  Status AddRow(std::span<const std::byte> texels, OpacityTiles& tiles);

  uint32_t width() const { return layout_.width; }
  uint32_t height() const { return layout_.height; }
  /// Of the whole image.
  TexelStates whole() const { return whole_; }
  /// Of texels [begin, end] of a row. Requires: they exist.
  TexelStates StatesIn(uint32_t row, uint32_t begin, uint32_t end, const OpacityTiles& tiles) const;

 private:
  static constexpr uint32_t kOpaque = 0xFFFFFFFFu, kTransparent = 0xFFFFFFFEu;
  Status EndStrip(OpacityTiles& tiles);

  TexelLayout layout_;
  OpacityRule rule_;
  uint32_t columns_, row_ = 0;
  std::vector<uint32_t> slots_;  ///< of each tile: kOpaque, kTransparent, or its number
  TexelStates whole_;
  std::array<TexelStates, 256> codes_;  ///< of 8-bit values
  std::vector<OpacityTile> strip_;      ///< tiles of the rows that are being added
};

}  // namespace quarry

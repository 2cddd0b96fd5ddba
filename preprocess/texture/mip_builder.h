#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// Makes the pages of all levels of a texture from its rows, in one pass. A texel is the exact mean of its
/// area in the finer level, also for odd sides, where it covers texels in part. Means are of linear light, of
/// colours weighted by alpha, and not rounded between levels. Memory: kPageSide rows of each level. Thread
/// safety: none.
class MipBuilder {
 public:
  /// Receives each page once, as soon as its last row has come; the order depends on the sides alone.
  using Emit = std::function<Status(uint32_t page, std::span<const std::byte> texels)>;
  MipBuilder(const TexelLayout& layout, Emit emit);

  /// Adds the next row of level 0, as stored. Errors: as `emit`'s.
  Status AddRow(std::span<const std::byte> texels);

 private:
  struct Level {
    Bytes strip;              ///< rows of the pages that are being filled
    uint32_t row = 0;         ///< the next row's number
    std::vector<float> mean;  ///< of the next level's row, incomplete
    std::vector<float> half;  ///< working memory: a row of half the width
  };
  Status Store(uint32_t level, std::span<const std::byte> texels);
  Status EmitStrip(uint32_t level);
  Status PassOn(uint32_t level, uint32_t row, const std::vector<float>& linear);
  Status AddLinear(uint32_t level, const std::vector<float>& linear);
  void Halve(const std::vector<float>& wide, uint32_t width, std::vector<float>& out) const;

  TexelLayout layout_;
  TextureShape shape_;
  Emit emit_;
  std::vector<Level> levels_;
  Bytes tail_, page_;
  std::vector<float> linear_;  ///< working memory: rows of level 0, and of others as stored
  Bytes texels_;
  size_t tail_filled_ = 0;
};

}  // namespace quarry

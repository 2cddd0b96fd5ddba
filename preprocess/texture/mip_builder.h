#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/texture_shape.h"

namespace quarry {

/// Makes the pages of all levels of a texture from its rows, in one pass. Each level is the one before
/// through a box filter: a texel is the mean of what it covers of the finer level, exactly so for odd sides
/// too, where it covers parts of texels. Means are of linear light, of colours weighed by their alpha, and
/// not rounded between levels. Memory: kPageSide rows of each level.
class MipBuilder {
 public:
  /// `emit` takes each page once, as soon as its last row has come: the same order for the same sides.
  using Emit = std::function<Status(uint32_t page, std::span<const std::byte> texels)>;
  MipBuilder(const TexelLayout& layout, Emit emit);

  /// The next row of level 0, as stored. Errors: those of `emit`.
  Status AddRow(std::span<const std::byte> texels);

 private:
  struct Level {
    Bytes strip;              ///< rows of the level's pages that are being filled
    uint32_t row = 0;         ///< that comes next
    std::vector<float> mean;  ///< of the next level's row, not yet complete
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
  size_t tail_filled_ = 0;
};

}  // namespace quarry

#pragma once

#include <array>
#include <cstdint>
#include <glm/vec3.hpp>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"

namespace quarry {

/// Cells of a photographed sky of `width` times half as many texels, up to 512x256 of nearly equal sides, in
/// rows from the zenith down. A cell may be divided into parts: its texels, or up to 32x32 blocks of texels.
class SkyCells {
 public:
  static constexpr uint32_t kMostColumns = 512, kMostPartsAside = 32;
  /// Texels of columns [x0, x1) and rows [y0, y1).
  struct Rect {
    uint32_t x0, y0, x1, y1;
    bool operator==(const Rect&) const = default;
  };

  /// Requires: `width` is even and at least 2.
  explicit SkyCells(uint32_t width);

  uint32_t width() const { return width_; }
  uint32_t height() const { return width_ / 2; }
  uint32_t columns() const { return columns_; }
  uint32_t count() const { return columns_ * rows_; }
  /// The cell of a texel.
  uint32_t CellOf(uint32_t x, uint32_t y) const;
  Rect RectOf(uint32_t cell) const;
  /// Parts of a cell if it is divided, row by row; the part of a texel of the cell; a part's texels.
  uint32_t PartsOf(uint32_t cell) const;
  uint32_t PartOf(uint32_t cell, uint32_t x, uint32_t y) const;
  Rect RectOf(uint32_t cell, uint32_t part) const;
  /// The cosine of the angle from the zenith to the upper edge of a row of texels, or to the lowest edge.
  double CosineAt(uint32_t row) const { return cosines_[row]; }
  double SolidAngle(const Rect& rect) const;

 private:
  uint32_t width_, columns_, rows_;
  std::vector<double> cosines_;
};

/// The table by which paths ask a photographed sky for light: each cell, and each part of the brightest, has
/// as many of 2^24 numbers as its share of the sky's power. One without a number is left to paths that meet
/// it. Whole numbers, so that every machine chooses alike. Memory: 8 bytes a cell, 4 a part, 8 a row of
/// texels; 6 MiB at most. Immutable, so thread-safe. Source: Pharr, Jakob & Humphreys 2023, section 12.5 (a
/// density by the image).
class SkyTable {
 public:
  static constexpr uint32_t kNumbers = 1u << 24, kMostDivided = 1024;

  /// The facts of a sky beside its texels. Radiance is that of texels times 2^exponent.
  struct Facts {
    int32_t exponent = 0;
    glm::vec3 mean{0};    ///< radiance over the sphere
    float brightest = 0;  ///< the largest channel of a texel
    bool operator==(const Facts&) const = default;
  };
  /// A cell that is divided, and the weights of its parts.
  struct Divided {
    uint32_t cell = 0;
    std::vector<double> weights;
  };
  /// The mean of the three channels counts as a place's brightness.
  /// Shapes: weights[cells.count()], each the power of a cell. Requires: some weight is positive; `divided`
  /// by ascending cell, at most kMostDivided.
  SkyTable(SkyCells cells, const Facts& facts, std::span<const double> weights,
           std::span<const Divided> divided);

  const SkyCells& cells() const { return cells_; }
  const Facts& facts() const { return facts_; }

  /// A place of the table and the chance that it is chosen.
  struct Choice {
    SkyCells::Rect rect;
    float chance = 0;
  };
  /// The place that a number chooses: [0, 1), a multiple of 2^-24.
  Choice Chosen(float number) const;
  /// The place that a texel lies in.
  Choice Around(uint32_t x, uint32_t y) const;

  /// The section ENVR (FORMAT.md), and its inverse, for an image of `width` texels.
  /// Errors: another size; numbers that do not fit; facts that cannot be.
  Bytes Encode() const;
  static Result<SkyTable> Decode(std::span<const std::byte> bytes, uint32_t width);

 private:
  SkyTable(SkyCells cells, const Facts& facts) : cells_(std::move(cells)), facts_(facts) {}
  Status TakeNumbers(ByteReader& in);
  Choice ChoiceOf(uint32_t cell, uint32_t place) const;

  SkyCells cells_;
  Facts facts_;
  std::vector<uint32_t> first_;  ///< by cell, and one past the last: its first place
  std::vector<uint32_t> end_;    ///< by place, a cell or a part: one past its numbers
};

/// Most bytes of a section ENVR.
inline constexpr uint64_t kMostSkyTableBytes = 8u << 20;

}  // namespace quarry

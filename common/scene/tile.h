#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>

#include "common/base/status.h"
#include "common/scene/view.h"

namespace quarry {

/// Classes of tiles; a worker renders the most urgent first. kRest: of a watched picture at rest. kMotion: of
/// one in motion, and of answers to a viewer.
enum class Urgency : uint8_t { kJob, kRest, kMotion };
inline constexpr size_t kUrgencies = 3;

/// The form of a lattice point in a tile's result.
enum class PixelForm : uint8_t {
  kMeans,  ///< four float32, the mean radiance and coverage of the view's samples; then the layers
  /// SumWords() int64, the sums of the tile's samples as FixedRadiance has them; then the layers, those that
  /// are averaged without a value
  kSums,
  /// A uint32, the mean of the tile's samples as PackShared() has it, kUncovered or kHole. A point that is
  /// covered in part counts as covered.
  kShown,
};
/// A point of kShown whose rays wait for blocks. PackShared() never gives it.
inline constexpr uint32_t kHole = 0xFFFFFFFFu;
/// A point of kShown that no sample covers. PackShared() never gives it.
inline constexpr uint32_t kUncovered = 0xFFFFFFFDu;

/// Limits of a tile: lattice points a side, and bytes of its result's points.
inline constexpr uint32_t kMaxTilePoints = 256;
inline constexpr size_t kMaxTileBytes = 256u << 10;

/// A part of a view that is rendered as a whole. A step above 1 selects a lattice of its pixels.
/// Units: pixels of the view. Requires: CheckTile().
struct Tile {
  PixelRect pixels;
  /// Side of the squares that have one lattice point each. 1: every pixel is a lattice point.
  uint32_t step = 1;
  /// Place of the lattice point in its square; kMiddle: in its middle. Squares that the tile cuts have a
  /// point all the same with kMiddle, at the border, and else only if the point lies in the tile. Requires:
  /// both are kMiddle or below `step`.
  static constexpr uint32_t kMiddle = ~uint32_t{0};
  uint32_t phase_x = kMiddle, phase_y = kMiddle;
  /// The samples [first_sample, first_sample + samples) of each point; 0 samples: all of the view's. Layers
  /// belong to sample 0. Requires: the view has them; kMeans has all.
  uint32_t first_sample = 0, samples = 0;
  PixelForm form = PixelForm::kMeans;
  /// Whether the tile ends once all its rays that have not ended wait for blocks, and leaves their points as
  /// holes. The blocks stay wanted. Requires: kShown, one sample.
  bool leaves_holes = false;

  uint32_t columns() const { return Points(pixels.width, phase_x); }
  uint32_t rows() const { return Points(pixels.height, phase_y); }
  /// The view's column or row of a lattice point.
  uint32_t X(uint32_t column) const { return pixels.x + Place(column, phase_x, pixels.width); }
  uint32_t Y(uint32_t row) const { return pixels.y + Place(row, phase_y, pixels.height); }
  /// The samples of each point of this view.
  uint32_t samples_of(uint32_t spp) const { return samples == 0 ? spp : samples; }

 private:
  uint32_t Points(uint32_t length, uint32_t phase) const {
    if (phase == kMiddle) return (length + step - 1) / step;
    return phase < length ? (length - phase + step - 1) / step : 0;
  }
  uint32_t Place(uint32_t point, uint32_t phase, uint32_t length) const {
    return std::min(point * step + (phase == kMiddle ? step / 2 : phase), length - 1);
  }
};

/// The sums of a point: of its colour, and of the layers that are averaged over samples, the normal and the
/// albedo. A normal's component is summed as 1 + itself, and as 1 where nothing is hit.
uint32_t SumWords(uint32_t aov_mask);
/// Bytes of a lattice point of a tile of this form.
size_t BytesPerPoint(PixelForm form, uint32_t aov_mask);

/// Errors: the tile does not lie in the view's crop, exceeds a limit, or asks for samples that the view does
/// not have or in a form that does not go with them.
Status CheckTile(const Tile& tile, const View& view);

}  // namespace quarry

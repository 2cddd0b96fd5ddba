#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/fixed_radiance.h"
#include "common/scene/view.h"

namespace quarry {

/// The blocks of a picture that end when their noise is low, and the noise of each.
/// Samples are looked at in stops: at 8, 16, 32, 64 ... samples, and at the view's last; of a view with less
/// than 16, at half of them and at all. A block's error is the relative standard error of its pixels (root
/// mean square), estimated from the sums of two parts of the samples, those before the last stop and those
/// after it. A pixel darker than a sixteenth of the metered grey counts as bright as that. From 16 samples
/// on, a block ends once its error and those of its eight neighbours are below View::noise; a neighbour that
/// has ended counts as below. All this depends on exact sums alone: not on the order of Measure() and End().
/// The estimate from two parts of the samples is that of Dammertz et al. 2010. Units: pixels of
/// the view. Not thread-safe.
class NoiseBlocks {
 public:
  static constexpr uint32_t kSide = 16;          ///< of a block, pixels
  static constexpr uint32_t kFirstSamples = 16;  ///< the fewest with which a block may end

  /// Whether a view's samples are to be looked at: it has a noise, or a layer of it.
  static bool Needs(const View& view) {
    return view.noise > 0 || view.has(Aov::kNoise) || view.has(Aov::kSamples);
  }
  /// Requires: the view is normalized.
  explicit NoiseBlocks(const View& view);
  /// Sets the view's metered exposure (EV), by which dark pixels are judged from now on.
  void SetExposure(double ev);

  /// The first stop after `samples`. Requires: the view has more than `samples`.
  uint32_t StopAfter(uint32_t samples) const;
  /// Whether blocks may end at a stop.
  bool MayEnd(uint32_t stop) const { return stop >= kFirstSamples && stop < spp_; }

  /// Sums of the pixels of a rectangle, row by row, `stride` words a pixel, the colour's first: of
  /// [0, first_samples), and of [0, samples).
  struct Sums {
    uint32_t first_samples = 0;
    const FixedRadiance* first = nullptr;
    uint32_t samples = 0;
    const FixedRadiance* all = nullptr;
    size_t stride = kColorWords;
  };
  /// Measures the error, at the stop `sums.samples`, of the blocks of `area` that have not ended.
  /// Requires: SetExposure(); `area` lies in the crop and consists of whole blocks, or of what the crop has
  /// of them.
  void Measure(const PixelRect& area, const Sums& sums);
  /// Whether all that End() needs has been measured.
  bool MayJudge(const PixelRect& area, uint32_t stop) const;
  /// Ends the blocks of `area` whose errors at the stop allow it. Requires: MayEnd(stop),
  /// MayJudge(area, stop).
  void End(const PixelRect& area, uint32_t stop);

  /// The rectangle around the blocks of `area` that have not ended; none: all have.
  std::optional<PixelRect> Open(const PixelRect& area) const;
  /// Rectangles, of whole blocks, that cover all blocks that have not ended, and no others.
  std::vector<PixelRect> AllOpen() const;
  bool ended(uint32_t x, uint32_t y) const { return at(x, y).ended; }
  /// The samples of a pixel when it was measured last, and its block's error then.
  uint32_t samples(uint32_t x, uint32_t y) const { return at(x, y).samples; }
  float error(uint32_t x, uint32_t y) const { return at(x, y).error; }
  /// The largest error of a block, and the mean number of samples of a pixel, as far as they are measured.
  float largest_error() const;
  double mean_samples() const;

 private:
  struct Block {
    float error = 0;
    uint32_t samples = 0;  ///< when it was measured last
    uint16_t below = 0;  ///< a bit for each stop from kFirstSamples on: whether its error was below the wish
    bool ended = false;
  };
  /// Blocks of an area: columns and rows, the last excluded.
  struct Range {
    uint32_t x0, y0, x1, y1;
  };
  Range BlocksOf(const PixelRect& area, uint32_t around) const;
  PixelRect PixelsOf(const Range& blocks) const;
  const Block& at(uint32_t x, uint32_t y) const {
    return blocks_[size_t{(y - crop_.y) / kSide} * columns_ + (x - crop_.x) / kSide];
  }
  Block& Of(uint32_t column, uint32_t row) { return blocks_[size_t{row} * columns_ + column]; }
  const Block& Of(uint32_t column, uint32_t row) const { return blocks_[size_t{row} * columns_ + column]; }

  PixelRect crop_;
  uint32_t spp_, columns_, rows_;
  int range_;  ///< the view's
  double wish_;
  double least_mean_ = 0;  ///< of a channel, in bits of FixedRadiance
  std::vector<Block> blocks_;
};

}  // namespace quarry

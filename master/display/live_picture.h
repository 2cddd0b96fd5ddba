#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/math/fixed_radiance.h"
#include "common/scene/tile.h"
#include "master/pictures/noise_blocks.h"

namespace quarry {

/// Codes of pixels without a colour: the ray waits for a block; nothing has been traced yet.
inline constexpr uint32_t kWaiting = kHole, kUntraced = kHole - 1;

/// Rows of a picture, to be encoded. Units: pixels.
struct PictureRows {
  uint32_t y = 0, width = 0;
  std::vector<uint32_t> codes;  ///< PackShared(), kUncovered, kWaiting or kUntraced, row by row
  /// coverage, 255 for all, row by row; empty: each pixel with a colour is covered
  std::vector<uint8_t> coverage;
  uint32_t height() const { return static_cast<uint32_t>(codes.size() / width); }
};

/// The pixels of a watched view, times 2^range of the view, while it is traced: first colours to show, then
/// exact sums of samples. Records which rows have changed since they were taken. Not thread-safe.
class LivePicture {
 public:
  /// Bytes that a pixel takes here, with sums and two copies of rows.
  static constexpr uint64_t kPixelBytes = 3 * (sizeof(uint32_t) + 1) + kColorWords * sizeof(FixedRadiance);
  /// Bytes more of one of a view with a noise.
  static constexpr uint64_t kNoiseBytes = kColorWords * sizeof(FixedRadiance);
  /// Number of rows that are sent together: a multiple of a JPEG's blocks.
  static constexpr uint32_t kBandRows = 32;

  /// Begins an empty picture of a view, in the memory of the last one unless that is much larger. Requires:
  /// the view is of a whole image.
  void Open(const View& view);

  /// Takes pixels of kShown, unless there are sums. Requires: the tile lies in the picture, as `pixels` has
  /// its bytes.
  void PutShown(const Tile& tile, std::span<const std::byte> pixels);
  /// Adds sums of kSums, which are shown from then on. Requires: as PutShown; ranges of samples come in order
  /// and without gaps, each for all of open() before the next, and none goes beyond StopAfter(samples());
  /// from the second stop on the exposure is set.
  void PutSums(const Tile& tile, std::span<const std::byte> pixels);

  uint32_t width() const { return width_; }
  uint32_t height() const { return height_; }
  uint64_t pixels() const { return uint64_t{width_} * height_; }
  /// Pixels that have a colour; pixels whose rays wait.
  uint64_t traced() const { return traced_; }
  uint64_t waiting() const { return waiting_; }
  /// The number of samples in the sums of all pixels that go on.
  uint32_t samples() const { return samples_; }
  /// The rectangles of pixels that go on. A picture has all its samples when there are none.
  const std::vector<PixelRect>& open() const { return open_; }
  /// The number of samples after which the noise is measured next, or the view's. Requires: open() is not
  /// empty.
  uint32_t StopAfter(uint32_t samples) const;
  /// Whether the next stop needs SetExposure(), which is NoiseBlocks'.
  bool needs_exposure() const { return first_samples_ > 0; }
  void SetExposure(double ev) { noise_->SetExposure(ev); }
  /// The noise of the picture's noisiest block; 0: not measured yet, or the view has none.
  float noise() const { return noise_ ? noise_->largest_error() : 0; }
  /// The colour as float32 means of all samples, as EncodeImage() takes them. `range`: the view's.
  /// Requires: open() is empty.
  std::vector<uint32_t> Means(int range) const;
  /// Codes of all pixels, row by row.
  const std::vector<uint32_t>& codes() const { return codes_; }
  /// Whether a tile has waiting pixels.
  bool Waits(const Tile& tile) const;

  /// Whether rows have changed.
  bool has_news() const { return any_news_; }
  /// All rows count as changed again.
  void Renew();
  /// The rows that have changed, as few runs.
  std::vector<PictureRows> TakeNews();
  /// Takes back the memory of used rows.
  void Reuse(std::vector<PictureRows> rows);

 private:
  void Set(uint32_t x, uint32_t y, uint32_t code);
  void Note(const Tile& tile);
  void PassStop();

  uint32_t width_ = 0, height_ = 0;
  std::vector<uint32_t> codes_;
  std::vector<FixedRadiance> sums_;  ///< kColorWords a pixel; empty before the first
  std::vector<uint8_t> coverage_;    ///< of the sums; empty before the first
  uint64_t traced_ = 0, waiting_ = 0;
  uint32_t samples_ = 0;
  uint64_t summed_ = 0;  ///< pixels that have the newest range
  uint32_t spp_ = 1;
  std::optional<NoiseBlocks> noise_;       ///< of a view that has a noise
  std::vector<FixedRadiance> first_sums_;  ///< at the last stop
  uint32_t first_samples_ = 0;
  std::vector<PixelRect> open_;
  uint64_t open_pixels_ = 0;
  std::vector<bool> news_;                    ///< by band
  std::vector<std::vector<uint32_t>> spare_;  ///< memory of rows
  bool any_news_ = false;
};

}  // namespace quarry

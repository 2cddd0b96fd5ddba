#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/bytes.h"
#include "common/engine/shading/surface.h"
#include "common/engine/view_context.h"
#include "common/kdtree/ray.h"
#include "common/math/fixed_radiance.h"
#include "common/voxel/block_key.h"

namespace quarry {

/// What a tile's result holds of each lattice point.
enum class PixelForm : uint8_t {
  kMeans,  ///< three float32, the mean radiance of the view's samples; then the layers
  kSums,   ///< three int64, the sum of the tile's samples as FixedRadiance has it; then the layers
  kShown,  ///< a uint32, the mean of the tile's samples as PackShared() has it, or kHole
};
/// A point of kShown whose rays wait for blocks. PackShared() never gives it.
inline constexpr uint32_t kHole = 0xFFFFFFFFu;

/// A part of a view that is rendered as a whole. A step above 1 selects a lattice of its pixels.
/// Units: pixels of the view. Requires: it lies in the view; no side exceeds 256 lattice points.
struct Tile {
  PixelRect pixels;
  /// Side of the squares that have one lattice point each. 1: every pixel is a lattice point.
  uint32_t step = 1;
  /// Whether the result is the hits of sample 0 instead of colours; nothing is shaded then.
  bool hits_only = false;
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
  uint32_t samples_of(uint32_t spp) const { return hits_only ? 1 : samples == 0 ? spp : samples; }

 private:
  uint32_t Points(uint32_t length, uint32_t phase) const {
    if (phase == kMiddle) return (length + step - 1) / step;
    return phase < length ? (length - phase + step - 1) / step : 0;
  }
  uint32_t Place(uint32_t point, uint32_t phase, uint32_t length) const {
    return std::min(point * step + (phase == kMiddle ? step / 2 : phase), length - 1);
  }
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  Bytes pixels;                  ///< the tile's PixelForm per point; empty with hits_only
  std::vector<Hit> hits;         ///< one per point; empty without hits_only
  std::vector<float> depths;     ///< per depth cell: t where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< blocks that its rays touched, ascending
  uint64_t rays = 0, rays_suspended = 0;
  uint32_t holes = 0;       ///< points of kHole
  uint64_t compute_us = 0;  ///< wall time of its thread without waits for blocks
};

/// The pixels of a tile under way: the sums of their samples' radiance, the layers and hits of sample 0, and
/// the depth cells. Sums do not depend on the order of samples: see FixedRadiance. Units: pixels are lattice
/// points of the tile, row by row; depths are scene units. Not thread-safe.
class TileFilm {
 public:
  /// Begins a tile and reuses the memory of the last.
  void Open(const ViewContext& view, const Tile& tile);

  void Add(uint32_t pixel, const glm::vec3& radiance) {
    FixedRadiance* to = &radiance_[size_t{3} * pixel];
    to[0].Add(radiance.x);
    to[1].Add(radiance.y);
    to[2].Add(radiance.z);
  }
  /// Notes that a primary ray of the depth cell ends at `depth` from the eye.
  void SawTo(uint32_t depth_cell, float depth) { depths_[depth_cell] = std::max(depths_[depth_cell], depth); }
  /// Sets the layers that the view asks for. `ray`: sample 0's; `hit.t` counts from the eye; `surface`: of
  /// the hit, if there is one.
  void SetLayers(const ViewContext& view, uint32_t pixel, const Ray& ray, const Hit& hit, float t_offset,
                 const Surface& surface);
  /// Notes that a point's ray has not ended. Requires: the tile leaves holes.
  void LeaveHole(uint32_t pixel) { holes_[pixel] = true; }
  /// Requires: the tile is of hits only.
  void SetHit(uint32_t pixel, const Hit& hit) { hits_[pixel] = hit; }

  /// Moves pixels, hits and depths into `result`.
  void Take(const ViewContext& view, RenderedTile& result);
  size_t memory_bytes() const {
    return depths_.size() * sizeof(float) + radiance_.size() * sizeof(FixedRadiance) + aovs_.size() * 4 +
           hits_.size() * sizeof(Hit);
  }

 private:
  void PutMeans(const ViewContext& view, Bytes& out) const;
  void PutSums(const ViewContext& view, Bytes& out) const;
  void PutShown(const ViewContext& view, Bytes& out) const;

  Tile tile_;
  std::vector<float> depths_;            ///< by depth cell
  std::vector<FixedRadiance> radiance_;  ///< 3 per pixel; empty with hits_only
  std::vector<uint32_t> aovs_;           ///< words - 3 per pixel; empty with hits_only
  std::vector<Hit> hits_;                ///< one per pixel; empty without hits_only
  std::vector<bool> holes_;              ///< by pixel; empty if the tile leaves none
};

}  // namespace quarry

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

/// A part of a view that is rendered as a whole. A step above 1 selects a lattice of its pixels.
/// Units: pixels of the view. Requires: it lies in the view; no side exceeds 256 lattice points.
struct Tile {
  PixelRect pixels;
  /// Side of the squares that have one lattice point each, at their middle. 1: every pixel is a lattice
  /// point.
  uint32_t step = 1;
  /// Whether the result is the hits of sample 0 instead of colours; nothing is shaded then.
  bool hits_only = false;

  uint32_t columns() const { return (pixels.width + step - 1) / step; }
  uint32_t rows() const { return (pixels.height + step - 1) / step; }
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  Bytes pixels;                  ///< ViewContext::words 32-bit words per point; empty with hits_only
  std::vector<Hit> hits;         ///< one per point; empty without hits_only
  std::vector<float> depths;     ///< per depth cell: t where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< blocks that its rays touched, ascending
  uint64_t rays = 0, rays_suspended = 0;
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
  /// Requires: the tile is of hits only.
  void SetHit(uint32_t pixel, const Hit& hit) { hits_[pixel] = hit; }

  /// Moves pixels, hits and depths into `result`.
  void Take(const ViewContext& view, RenderedTile& result);
  size_t memory_bytes() const {
    return depths_.size() * sizeof(float) + radiance_.size() * sizeof(FixedRadiance) + aovs_.size() * 4 +
           hits_.size() * sizeof(Hit);
  }

 private:
  Bytes Pixels(const ViewContext& view) const;

  std::vector<float> depths_;            ///< by depth cell
  std::vector<FixedRadiance> radiance_;  ///< 3 per pixel; empty with hits_only
  std::vector<uint32_t> aovs_;           ///< words - 3 per pixel; empty with hits_only
  std::vector<Hit> hits_;                ///< one per pixel; empty without hits_only
};

}  // namespace quarry

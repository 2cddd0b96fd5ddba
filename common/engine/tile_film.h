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

/// A part of a view to be rendered at once.
/// Units: pixels of the view. Requires: it lies in the view, no side longer than 256 lattice points.
struct Tile {
  PixelRect pixels;
  /// Of each square of so many pixels a side one is rendered, at its middle; 1: all.
  uint32_t step = 1;
  /// Hits of sample 0 instead of colours: nothing is shaded, no ray is sent on.
  bool hits_only = false;

  uint32_t columns() const { return (pixels.width + step - 1) / step; }
  uint32_t rows() const { return (pixels.height + step - 1) / step; }
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  Bytes pixels;                  ///< ViewContext::words 32-bit words a point; empty with hits_only
  std::vector<Hit> hits;         ///< one a point; empty without hits_only
  std::vector<float> depths;     ///< a depth cell of points each: where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< that its rays have been in, ascending
  uint64_t rays = 0, rays_suspended = 0;
  uint64_t compute_us = 0;  ///< wall time of its thread, waiting for blocks not counted
};

/// The pixels of a tile under way: the sums of their samples' radiance, the layers and hits of sample 0, and
/// the depth cells. Sums do not depend on the order of samples: see FixedRadiance. Units: pixels are lattice
/// points of the tile, row by row; depths are scene units. Not thread-safe.
class TileFilm {
 public:
  /// Begins a tile; memory of the one before is used again.
  void Open(const ViewContext& view, const Tile& tile);

  void Add(uint32_t pixel, const glm::vec3& radiance) {
    FixedRadiance* to = &radiance_[size_t{3} * pixel];
    to[0].Add(radiance.x);
    to[1].Add(radiance.y);
    to[2].Add(radiance.z);
  }
  /// A primary ray of the depth cell ends so far from the eye.
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
  std::vector<FixedRadiance> radiance_;  ///< 3 a pixel; empty with hits_only
  std::vector<uint32_t> aovs_;           ///< words - 3 a pixel; empty with hits_only
  std::vector<Hit> hits_;                ///< one a pixel; empty without hits_only
};

}  // namespace quarry

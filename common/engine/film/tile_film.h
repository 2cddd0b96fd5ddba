#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "common/base/bytes.h"
#include "common/engine/film/edge_map.h"
#include "common/engine/surfaces/surface.h"
#include "common/engine/view_context.h"
#include "common/kdtree/ray.h"
#include "common/math/fixed_radiance.h"
#include "common/scene/ray_query.h"
#include "common/scene/tile.h"
#include "common/voxel/block_key.h"

namespace quarry {

/// The surface at a hit of a list of rays.
struct HitSurface {
  uint32_t part = kNoIndex, material = kNoIndex;
  glm::vec3 normal{0};  ///< of unit length, by the winding of the triangle
};

/// Faults in a tile's light.
struct FilmFaults {
  uint64_t saturated = 0, not_numbers = 0;  ///< terms of sums: clamped at FixedRadiance::kMost; NaN
  uint64_t long_light_rays = 0;             ///< light rays of mode path that passed kMostCounted surfaces
  static constexpr uint8_t kMostCounted = 255;
};

/// A tile's result. Shapes: rows() x columns() lattice points, row by row.
struct RenderedTile {
  bool begun = true;             ///< false: the tile was given back, and all below is empty
  Bytes pixels;                  ///< the tile's PixelForm per point; empty for a list of rays
  std::vector<Hit> hits;         ///< of a list: one per ray; of RayGoal::kAll as many as `counts` says
  std::vector<float> depths;     ///< per depth cell: t where the farthest primary ray ends
  std::vector<BlockKey> blocks;  ///< that its rays touched, ascending; see TouchedBlocks
  uint64_t rays = 0, rays_suspended = 0;
  uint32_t holes = 0;       ///< points of kHole
  uint64_t compute_us = 0;  ///< wall time of its thread without waits for blocks
  FilmFaults faults;
  std::vector<uint32_t> counts;      ///< of RayGoal::kCount and kAll: hits of each ray
  std::vector<HitSurface> surfaces;  ///< one per hit, if they were asked for
};

/// The pixels of a tile under way: the sums of their samples' radiance and coverage and of averaged layers,
/// the other layers and hits of sample 0, and the depth cells. Sums do not depend on the order of samples:
/// see FixedRadiance. Units: pixels are lattice points of the tile, row by row; depths are scene units. Not
/// thread-safe.
class TileFilm {
 public:
  /// Begins a tile and reuses the memory of the last.
  void Open(const ViewContext& view, const Tile& tile);
  /// Begins a list of rays, which has hits and no pixels.
  void OpenHits(size_t count, RayGoal goal, bool has_surfaces);

  void Add(uint32_t pixel, const glm::vec3& radiance) {
    const float most = FixedRadiance::kMost;
    if (!(radiance.x < most && radiance.y < most && radiance.z < most)) NoteFault(radiance);
    FixedRadiance* to = &sums_[size_t{stride_} * pixel];
    to[0].Add(radiance.x);
    to[1].Add(radiance.y);
    to[2].Add(radiance.z);
  }
  void NoteLongLightRay() { ++faults_.long_light_rays; }
  /// Notes that the primary ray of a sample hits something, or sees light.
  void Cover(uint32_t pixel) { sums_[size_t{stride_} * pixel + 3].Add(1); }
  /// Notes that a primary ray of the depth cell ends at `depth` from the eye.
  void SawTo(uint32_t depth_cell, float depth) { depths_[depth_cell] = std::max(depths_[depth_cell], depth); }
  /// Sets the layers that the view asks for. `ray`: sample 0's; `hit.t` counts from the eye;
  /// `surface`, `albedo`: of the hit, if there is one.
  void SetLayers(const ViewContext& view, uint32_t pixel, const Ray& ray, const Hit& hit, float t_offset,
                 const Surface& surface, const glm::vec3& albedo);
  /// Adds a sample's part of the layers that are averaged. Requires: each sample's primary ray does so once.
  void AddAverages(const ViewContext& view, uint32_t pixel, bool is_hit, const glm::vec3& normal,
                   const glm::vec3& albedo);
  /// The lines of the tile.
  EdgeMap& edges() { return edges_; }
  /// Notes that a point's ray has not ended. Requires: the tile leaves holes.
  void LeaveHole(uint32_t pixel) { holes_[pixel] = true; }
  /// Requires: a list of rays; `pixel` is the ray's number.
  void SetHit(uint32_t pixel, const Hit& hit) { hits_[pixel] = hit; }
  void SetSurface(uint32_t pixel, const Surface& surface) { surfaces_[pixel] = SurfaceOf(surface); }
  /// Adds the next hit of a ray. Requires: the goal is kCount or kAll.
  void AddHit(uint32_t pixel, const Hit& hit) {
    ++counts_[pixel];
    if (!keeps_all_) return;
    hits_.push_back(hit);
    ray_of_hit_.push_back(static_cast<uint16_t>(pixel));
  }
  /// Adds the surface of the hit just added. Requires: the goal is kAll.
  void AddSurface(const Surface& surface) { surfaces_.push_back(SurfaceOf(surface)); }

  /// Moves pixels, hits and depths into `result`.
  void Take(const ViewContext& view, RenderedTile& result);
  size_t memory_bytes() const {
    return depths_.size() * sizeof(float) + sums_.size() * sizeof(FixedRadiance) + aovs_.size() * 4 +
           hits_.size() * sizeof(Hit) + counts_.size() * sizeof(uint32_t) +
           surfaces_.size() * sizeof(HitSurface) + ray_of_hit_.size() * sizeof(uint16_t) +
           edges_.memory_bytes();
  }

 private:
  static HitSurface SurfaceOf(const Surface& s) { return {s.part, s.material, s.geometric_normal}; }
  void NoteFault(const glm::vec3& radiance);
  void SortHits();
  void PutMeans(const ViewContext& view, Bytes& out) const;
  void PutSums(const ViewContext& view, Bytes& out) const;
  void PutShown(const ViewContext& view, Bytes& out) const;

  Tile tile_;
  std::vector<float> depths_;         ///< by depth cell
  uint32_t stride_ = kColorWords;     ///< SumWords()
  std::vector<FixedRadiance> sums_;   ///< stride_ per pixel
  std::vector<uint32_t> aovs_;        ///< words - kColorWords per pixel
  std::vector<Hit> hits_;             ///< one per ray of a list, or all in the order in which they came
  std::vector<HitSurface> surfaces_;  ///< of hits_
  std::vector<uint32_t> counts_;      ///< by ray
  std::vector<uint16_t> ray_of_hit_;
  bool keeps_all_ = false;  ///< the goal is kAll
  FilmFaults faults_;
  EdgeMap edges_;
  std::vector<bool> holes_;  ///< by pixel; empty if the tile leaves none
};

}  // namespace quarry

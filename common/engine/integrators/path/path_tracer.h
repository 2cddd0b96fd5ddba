#pragma once

#include "common/engine/blocks/environment_pages.h"
#include "common/engine/integrators/light_rays.h"
#include "common/engine/integrators/path/path_lights.h"
#include "common/scene/surface_properties.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Mode `path`: light that bounces. A path never splits: it has one ray, or one light ray, under way. Each
/// vertex samples one light and one direction, which are weighed by the power heuristic. From the third
/// bounce on paths end by chance. The ray behind the last bounce finds lights only. Source: Kajiya 1986;
/// Veach 1997, chapter 9 (multiple importance sampling); Purcell et al. 2002, section 4, the path tracer.
class PathTracer final : public LightRays {
 public:
  /// `view` is normalized, and outlives this.
  PathTracer(const View& view, const Catalog& scene, LightWays ways = LightWays::kBoth,
             const EnvironmentPages& environment = {}, EmitterChoice choice = EmitterChoice::kNear);

  Needs needs() const override;
  void Begin(PacketWork& work, uint64_t lanes) const override;
  uint64_t Missed(PacketWork& work, uint64_t lanes) const override;
  void Shade(PacketWork& work, uint64_t lanes) const override;
  uint64_t SendLightRays(PacketWork& work, uint64_t lanes) const override;

 protected:
  bool tints() const override { return true; }
  bool LooksAtSeeThrough(const PacketWork& /*work*/) const override { return true; }
  float End(const PacketWork& work, uint32_t lane) const override;
  void Arrived(PacketWork& work, uint64_t lanes) const override;
  bool TintBy(PacketWork& work, uint32_t lane, const VoxelGeometry& voxel,
              const SurfaceProperties& pane) const override;

 private:
  /// The result of a hit: the ray passes it, its path ends there, or it scatters there.
  enum class Outcome { kPasses, kEnds, kScatters };
  bool LeavesOut(const PathPacket& path, uint32_t lane) const;
  Outcome Meet(PacketWork& work, uint32_t lane, const SurfaceProperties& properties) const;
  template <class Bsdf>
  void ScatterBy(PacketWork& work, uint32_t lane, const Bsdf& bsdf) const;
  template <class Bsdf>
  void AskLight(PacketWork& work, uint32_t lane, const Bsdf& bsdf) const;
  void GoOn(PacketWork& work, uint64_t lanes, SamplePacket::Stage from) const;
  void EndPaths(PacketWork& work, uint64_t lanes) const;
  uint64_t EndInSky(PacketWork& work, uint64_t lanes) const;

  const View& view_;
  const PathLights lights_;
  const float scale_;            ///< of radiance in sums, see View::range
  bool can_find_light_ = false;  ///< whether the ray behind the last bounce may find a light
};

}  // namespace quarry

#pragma once

#include "common/engine/integrators/integrator.h"

namespace quarry {

/// Follows light rays: shadow rays, occlusion rays, and rays of lists that may end at any hit. A ray that has
/// met no opaque hit, but see-through triangles, passes them where they have holes, and glass where it
/// `tints`. One such triangle is looked at directly; for several the ray is traced again from triangle to
/// triangle.
class LightRays : public Integrator {
 public:
  void Shadowed(PacketWork& work, uint64_t lanes) const final;
  void Passed(PacketWork& work, uint64_t lanes) const final;
  uint64_t Tint(PacketWork& work, uint64_t lanes) const final;

 protected:
  /// Whether glass lets light rays pass, tinted; else it stops them.
  virtual bool tints() const { return false; }
  /// Whether see-through triangles must be looked at. False: a ray that has met one is stopped.
  virtual bool LooksAtSeeThrough(const PacketWork& work) const = 0;
  /// Where the lane's light ray ends. Units: t.
  virtual float End(const PacketWork& work, uint32_t lane) const = 0;
  /// Takes up the light rays of `lanes` that came to their ends: adds their light.
  virtual void Arrived(PacketWork& work, uint64_t lanes) const;
  /// Takes up the light rays of `lanes` that were stopped by hits.
  virtual void Stopped(PacketWork& work, uint64_t lanes) const;
  /// Tints a light ray by the triangle of `voxel` that it has hit, whose properties are `pane`. Returns:
  /// whether light is left; then the ray goes on behind the triangle, up to its end.
  virtual bool TintBy(PacketWork& work, uint32_t lane, const VoxelGeometry& voxel,
                      const SurfaceProperties& pane) const;

 private:
  void GoOn(PacketWork& work, uint64_t more, uint64_t arrived) const;
};

}  // namespace quarry

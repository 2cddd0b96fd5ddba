#pragma once

#include <glm/vec3.hpp>

#include "common/engine/integrators/light_rays.h"
#include "common/scene/view.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Mode `ao`: a studio's light, part of which occlusion rays of limited length look for. Glass counts as
/// opaque, since it is drawn so; only holes of triangles let rays pass.
class AmbientOcclusion final : public LightRays {
 public:
  AmbientOcclusion(const View& view, const SceneMeta& scene);
  Needs needs() const override;
  void Shade(PacketWork& work, uint64_t lanes) const override;
  uint64_t SendLightRays(PacketWork& work, uint64_t lanes) const override;

 protected:
  bool LooksAtSeeThrough(const PacketWork& work) const override { return work.view.filter != nullptr; }
  float End(const PacketWork& /*work*/, uint32_t /*lane*/) const override { return distance_; }

 private:
  const uint64_t seed_;
  const uint32_t rays_;     ///< occlusion rays of a surface
  const float distance_;    ///< their length, scene units
  const glm::vec3 zenith_;  ///< the dome's; a unit vector
};

}  // namespace quarry

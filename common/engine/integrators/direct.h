#pragma once

#include "common/engine/integrators/light_rays.h"

namespace quarry {

/// Mode `shadow`: the lights of the view, with shadows, and ambient light.
class Direct : public LightRays {
 public:
  /// Requires: `view` outlives this.
  explicit Direct(const View& view) : Direct(view, BaseColor, SamplePacket::kNext) {}
  Needs needs() const override;
  void Shade(PacketWork& work, uint64_t lanes) const override;
  uint64_t SendLightRays(PacketWork& work, uint64_t lanes) const override;

 protected:
  /// `albedo`: the colour that scatters light; `after`: the stage after the last light.
  Direct(const View& view, AlbedoOf albedo, SamplePacket::Stage after)
      : view_(view), albedo_(albedo), after_(after) {}
  bool tints() const override { return true; }
  bool LooksAtSeeThrough(const PacketWork& /*work*/) const override { return true; }
  float End(const PacketWork& work, uint32_t lane) const override;

 private:
  const View& view_;
  const AlbedoOf albedo_;
  const SamplePacket::Stage after_;
};

}  // namespace quarry

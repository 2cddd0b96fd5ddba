#pragma once

#include "common/engine/integrators/integrator.h"

namespace quarry {

/// Keeps the surfaces that rays of EdgeRays hit in the film's edge map, for EdgeMap::Finish(). Its samples
/// have no light.
class EdgeSurfaces final : public Integrator {
 public:
  Needs needs() const override { return {.pixels = false}; }
  void Shade(PacketWork& work, uint64_t lanes) const override;
};

}  // namespace quarry

#pragma once

#include "common/engine/integrators/integrator.h"

namespace quarry {

/// Mode `raycast`: surfaces by a light at the eye. No ray follows the first.
class Raycast final : public Integrator {
 public:
  Needs needs() const override;
  void Shade(PacketWork& work, uint64_t lanes) const override;
};

/// Mode `voxels`: a colour for each voxel, by a light at the eye.
/// Source: Wald & Slusallek 2001, figure 11.
class VoxelColors final : public Integrator {
 public:
  Needs needs() const override { return {}; }
  void Shade(PacketWork& work, uint64_t lanes) const override;
};

}  // namespace quarry

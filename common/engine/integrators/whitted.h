#pragma once

#include "common/engine/integrators/direct.h"

namespace quarry {

/// Mode `whitted`: the lights of the view, and the rays that mirrors reflect and glass transmits.
/// Source: Whitted 1980.
class Whitted final : public Direct {
 public:
  explicit Whitted(const View& view) : Direct(view, DiffuseColor, SamplePacket::kBounce) {}
  Needs needs() const override;
  void Bounce(PacketWork& work, uint64_t lanes) const override;
};

}  // namespace quarry

#pragma once

#include "common/engine/integrators/light_rays.h"

namespace quarry {

/// No picture: hits of each ray, with their surfaces if these are asked for.
class HitsInOrder : public Integrator {
 public:
  explicit HitsInOrder(bool surfaces = false, HitRule rule = {}) : surfaces_(surfaces), rule_(rule) {}
  Needs needs() const final {
    return {.surfaces = surfaces_, .attributes = false, .pixels = false, .hits = rule_};
  }

 protected:
  bool has_surfaces() const { return surfaces_; }

 private:
  bool surfaces_;
  HitRule rule_;
};

/// The nearest hit of each ray.
class NearestHits final : public HitsInOrder {
 public:
  using HitsInOrder::HitsInOrder;
  void Shade(PacketWork& work, uint64_t lanes) const override;
};

/// All hits of each ray, in the order of (t, triangle).
class AllHits final : public HitsInOrder {
 public:
  using HitsInOrder::HitsInOrder;
  void Shade(PacketWork& work, uint64_t lanes) const override;
};

/// No picture: some hit of each ray, if it has one: its `t` and its triangle.
class AnyHits final : public LightRays {
 public:
  explicit AnyHits(HitRule rule = {}) : rule_(rule) {}
  Needs needs() const override {
    return {.surfaces = false, .attributes = false, .pixels = false, .any_hit = true, .hits = rule_};
  }
  void Shade(PacketWork& /*work*/, uint64_t /*lanes*/) const override {}
  uint64_t SendLightRays(PacketWork& work, uint64_t lanes) const override;

 protected:
  bool LooksAtSeeThrough(const PacketWork& /*work*/) const override { return true; }
  float End(const PacketWork& work, uint32_t lane) const override;
  void Arrived(PacketWork& /*work*/, uint64_t /*lanes*/) const override {}
  void Stopped(PacketWork& work, uint64_t lanes) const override;

 private:
  HitRule rule_;
};

}  // namespace quarry

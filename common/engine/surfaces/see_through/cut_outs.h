#pragma once

#include "common/engine/packet_work.h"
#include "common/engine/surfaces/see_through/hit_filter.h"
#include "common/scene/ray_query.h"

namespace quarry {

/// Rejects hits in the holes of triangles: by the mask of the triangle, else by its opacity map; and hits of
/// glass, if the rule says so.
class CutOuts final : public HitFilter {
 public:
  explicit CutOuts(HitRule rule = {}) : rule_(rule) {}
  void Begin(PacketWork& work, uint64_t lanes) const override;
  Verdict Test(PacketWork& work, uint64_t lanes) const override;

 private:
  /// The outcome of a step of a test. kOpen: the next step decides.
  enum class Cut { kThere, kInHole, kWaits, kOpen };
  Cut TestHit(const PacketWork& work, uint32_t lane, HotBlockOfLane& hot) const;
  static Cut TestMask(const PacketWork& work, uint32_t lane, HotBlockOfLane& hot);
  static Cut PlaceUv(const PacketWork& work, uint32_t lane);
  Cut TestOpacity(const PacketWork& work, uint32_t lane) const;

  HitRule rule_;
};

}  // namespace quarry

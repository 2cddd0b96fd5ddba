#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>

#include "common/engine/blocks/voxel_source.h"
#include "common/engine/scene.h"
#include "common/scene/view.h"
#include "master/display/viewer_message.h"
#include "master/part_selections.h"
#include "master/schedule/ray_dispatcher.h"

namespace quarry {

/// Answers a viewer's picks: the visible surface at a pixel of its view, or along a ray of the viewer's own.
/// A pick is one ray, traced by a worker. The block of the triangle that it hits is then fetched, for the
/// point and the normal by the triangle's vertices, its part and its material. No sockets. Not thread-safe.
class Picker {
 public:
  /// Limit of pending picks; a newer one replaces the oldest.
  static constexpr size_t kMost = 8;
  /// `rays`, `scene`, `selections` (of the scene) and `source` (of its blocks) must outlive this. `answer`
  /// gets the answers for the viewer as JSON; it is not called after this object is destroyed.
  Picker(RayDispatcher& rays, const Scene& scene, VoxelSource& source, PartSelections& selections,
         std::function<void(std::string)> answer)
      : rays_(rays),
        scene_(scene),
        source_(source),
        selections_(selections),
        answer_(std::make_shared<const Answer>(std::move(answer))) {}
  ~Picker();

  /// Asks for the surface at a pixel, or along the pick's ray. A place outside the view is moved to its
  /// border. Requires: `view` is normalized.
  void Ask(const PickMessage& pick, const View& view);

 private:
  using Answer = std::function<void(std::string)>;
  RayQuery RayOf(const PickMessage& pick, const View& view) const;
  void OnHit(uint64_t pick, const RayQuery& ray, const glm::dvec3& eye, const View& view, const RayDone& hit);

  RayDispatcher& rays_;
  const Scene& scene_;
  VoxelSource& source_;
  PartSelections& selections_;
  std::shared_ptr<const Answer> answer_;  ///< blocks that come later find it gone
  std::map<uint32_t, uint64_t> asked_;    ///< picks under way, by their rays
};

}  // namespace quarry

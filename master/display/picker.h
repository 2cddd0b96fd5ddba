#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <utility>

#include "common/engine/blocks/voxel_source.h"
#include "common/engine/scene.h"
#include "master/display/viewer_message.h"
#include "master/schedule/live_dispatcher.h"

namespace quarry {

/// Answers a viewer's picks: what a pixel of its view shows. A pick is a frame of one pixel with all layers,
/// traced by a worker. The point and the normal are then computed from the vertices of the triangle, whose
/// block is fetched. No sockets. Not thread-safe.
class Picker {
 public:
  /// The picks that may be under way; a newer one replaces the oldest.
  static constexpr size_t kMost = 8;
  /// `dispatcher`, `scene` and `source` (of the scene's blocks) must outlive this. `viewer`: its number at
  /// the dispatcher. `answer` takes the answers for the viewer, JSON; none comes after this is destroyed.
  Picker(LiveDispatcher& dispatcher, const Scene& scene, VoxelSource& source, uint32_t viewer,
         std::function<void(std::string)> answer)
      : dispatcher_(dispatcher),
        scene_(scene),
        source_(source),
        viewer_(viewer),
        answer_(std::make_shared<const Answer>(std::move(answer))) {}

  /// Asks what is seen at a pixel. A place beside the view is moved to its border. Requires: `view` is
  /// normalized.
  void Ask(const PickMessage& pick, View view);
  /// Takes a finished tile. False: the tile is of no pick.
  bool Take(const LiveTile& tile, std::span<const std::byte> pixels);

 private:
  using Answer = std::function<void(std::string)>;
  struct Asked {
    uint64_t pick;
    View view;
  };
  LiveDispatcher& dispatcher_;
  const Scene& scene_;
  VoxelSource& source_;
  const uint32_t viewer_;
  std::shared_ptr<const Answer> answer_;  ///< blocks that come later find it gone
  std::map<FrameId, Asked> asked_;
};

}  // namespace quarry

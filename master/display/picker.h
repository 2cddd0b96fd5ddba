#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "common/engine/scene.h"
#include "master/display/viewer_message.h"
#include "master/schedule/live_dispatcher.h"

namespace quarry {

/// Answers a viewer's picks: what a pixel of its view shows. A pick is a frame of one pixel with all layers,
/// traced by a worker. No sockets. Not thread-safe.
class Picker {
 public:
  /// The picks that may be under way; a newer one replaces the oldest.
  static constexpr size_t kMost = 8;
  /// `dispatcher` and `scene` must outlive this. `viewer`: its number at the dispatcher.
  Picker(LiveDispatcher& dispatcher, const Scene& scene, uint32_t viewer)
      : dispatcher_(dispatcher), scene_(scene), viewer_(viewer) {}

  /// Asks what is seen at a pixel. A place beside the view is moved to its border. Requires: `view` is
  /// normalized.
  void Ask(const PickMessage& pick, View view);
  /// Takes a finished tile. Returns the answer for the viewer, JSON; empty: the tile is of no pick.
  std::string Take(const LiveTile& tile, std::span<const std::byte> pixels);

 private:
  struct Asked {
    uint64_t pick;
    View view;
  };
  LiveDispatcher& dispatcher_;
  const Scene& scene_;
  const uint32_t viewer_;
  std::map<FrameId, Asked> asked_;
};

}  // namespace quarry

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <span>
#include <vector>

#include "common/scene/tile.h"

namespace quarry {

/// Names a frame under way, in messages of this master only. Never used twice.
using FrameId = uint64_t;

/// A tile's grant to a worker. Units: seconds of the caller's clock.
struct TileLease {
  uint64_t number = 0;
  uint32_t worker = 0;
  double since_s = 0;
  Tile area;  ///< what was ordered; of a job's frame
};

/// Workers that may hold a tile of a watched frame, or a ray.
inline constexpr size_t kMostLiveHolders = 4;

/// The leases of one frame's tiles, of a job's frame or a watched one, or of single rays, which count as
/// tiles here. Several workers may hold a tile: their results are the same, and the first counts. Units:
/// seconds of the caller's clock. Not thread-safe.
class Leases {
 public:
  /// Leases a tile to a worker. Returns the lease's number, which the frame uses once.
  uint64_t Give(uint32_t tile, uint32_t worker, double now_s, const Tile& area = {});
  /// The number of the next lease.
  uint64_t next() const { return next_; }
  /// Null: there is no such lease of the tile.
  const TileLease* Find(uint32_t tile, uint64_t number) const;
  /// Ends a lease. None: there is no such lease of the tile.
  std::optional<TileLease> End(uint32_t tile, uint64_t number);
  /// Ends all leases of a tile.
  void EndAll(uint32_t tile);
  /// Ends a lease of a tile that the worker has not begun. Ignores leases that it does not hold.
  void GiveBack(uint32_t worker, uint64_t number);
  /// Ends the worker's leases. Returns their tiles.
  std::vector<uint32_t> Forget(uint32_t worker);

  size_t size() const { return size_; }
  /// The leases of a tile, the oldest first. Valid until a lease is given or ends.
  std::span<const TileLease> Of(uint32_t tile) const;
  bool Holds(uint32_t worker, uint32_t tile) const;
  /// Calls `take` for each lease, by tile, the oldest first.
  template <class Take>
  void ForEach(Take take) const {
    for (const auto& [tile, leases] : by_tile_)
      for (const TileLease& lease : leases) take(tile, lease);
  }

  /// The late tiles, each of which another worker is to have too; tiles given out least recently are first. A
  /// tile is late at once if none of its holders answers; else when the newest has held it for `after_s`,
  /// doubled with each holder that answers.
  std::vector<uint32_t> Late(double now_s, const std::function<double(uint32_t tile)>& after_s,
                             const std::function<bool(uint32_t worker)>& answers) const;

 private:
  template <class Ends>
  std::vector<uint32_t> EndIf(Ends ends);

  std::map<uint32_t, std::vector<TileLease>> by_tile_;  ///< none is empty
  size_t size_ = 0;
  uint64_t next_ = 1;
};

}  // namespace quarry

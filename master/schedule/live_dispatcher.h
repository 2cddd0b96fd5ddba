#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "common/protocol/messages.h"
#include "master/schedule/leases.h"

namespace quarry {

/// Frames that somebody watches are numbered from here, so that they are never among the frames that end
/// before a batch frame (FrameSetup::oldest).
inline constexpr FrameId kFirstLiveFrame = uint64_t{1} << 62;

/// Which tiles go first. All of them go before tiles of batch frames.
enum class LiveUrgency : uint8_t { kAnswer, kMotion, kRest };
inline constexpr size_t kLiveUrgencies = 3;

/// A traced part of a live frame.
struct LiveTile {
  FrameId frame = 0;
  uint32_t viewer = 0;  ///< whose frame it is
  Tile area;
  uint32_t worker = 0;
  uint64_t rays = 0;
};

/// Gives tiles of watched views to workers: cuts the points to be traced into tiles that cost about two
/// milliseconds, sends a part of the screen to the worker that traced it last, divides the workers' time
/// among viewers, leases late tiles again, and tells workers which frames have ended. No socket, no clock, no
/// thread, no foresight. Units: seconds of any clock that does not go back. Not thread-safe.
class LiveDispatcher {
 public:
  /// The way of orders to workers. Called within Assign(); must not call back.
  class Sink {
   public:
    virtual ~Sink() = default;
    /// Before the worker's first tile of a frame.
    virtual void SetUp(uint32_t worker, FrameId frame, const View& view) = 0;
    virtual void Order(uint32_t worker, TileOrder order) = 0;
    /// These frames have ended. At most kMaxFramesEnded at once.
    virtual void End(uint32_t worker, std::vector<FrameId> frames) = 0;
  };

  /// `sink` must outlive this. `first`: the first frame's number, at least kFirstLiveFrame.
  LiveDispatcher(Sink& sink, FrameId first) : sink_(sink), next_frame_(first) {}

  /// Requires: the worker is not here.
  void AddWorker(uint32_t id, uint32_t threads);
  /// Its tiles go to other workers. A worker that is not here is ignored.
  void RemoveWorker(uint32_t id);
  /// Removes a worker that is still connected: the ends of its frames are announced first.
  void DismissWorker(uint32_t id);
  bool has_workers() const { return !workers_.empty(); }
  /// Compute threads of all workers.
  uint32_t threads() const;

  /// A new frame of a viewer. Requires: `view` is normalized.
  FrameId Begin(uint32_t viewer, const View& view);
  /// Forgets a frame and its tiles, begun or not.
  void End(FrameId frame);
  /// Ends all frames of a viewer and forgets it.
  void RemoveViewer(uint32_t viewer);
  /// Wants `area` to be traced, in as many tiles as are worth it. Requires: the frame has not ended; the
  /// area's parts satisfy CheckTile().
  void Trace(FrameId frame, const Tile& area, LiveUrgency urgency);
  /// The samples that a range of so many pixels should have at most, so that none of its tiles keeps others
  /// waiting for long, and the picture is shown again soon.
  uint32_t SamplesAtOnce(uint32_t viewer, uint64_t pixels) const;
  /// Whether the worker has been given a tile of the frame that is not finished.
  bool Holds(uint32_t worker, FrameId frame) const;
  /// Whether tiles of this urgency are wanted that have not been finished.
  bool Wants(FrameId frame, LiveUrgency urgency) const;

  /// Sends tiles to workers that have room for them.
  void Assign(double now_s);
  /// A worker's result. None: nobody waits for it. Errors: more or fewer bytes than the tile has.
  Result<std::optional<LiveTile>> Finish(uint32_t worker, const TileDone& done, size_t pixel_bytes);

 private:
  struct Wanted {
    Tile area;
    LiveUrgency urgency;
  };
  struct Frame {
    uint32_t viewer;
    View view;
    std::map<uint32_t, Wanted> tiles;                       ///< by number, until they are finished
    Leases leases;                                          ///< of these
    std::array<std::deque<uint32_t>, kLiveUrgencies> open;  ///< numbers of tiles that nobody holds
    std::array<uint32_t, kLiveUrgencies> unfinished{};
    uint32_t next_tile = 0;
  };
  struct Worker {
    uint32_t threads;
    uint32_t held = 0;            ///< tiles
    std::set<FrameId> announced;  ///< frames that the worker was given
    std::vector<FrameId> ended;   ///< of these: their end is still to be announced
    bool MayHave(LiveUrgency urgency) const;
  };
  static constexpr uint32_t kCells = 32;  ///< a side, of the grid of owners
  struct Viewer {
    double used_s = 0;      ///< computing ordered so far
    double point_s = 2e-6;  ///< computing a sample of a lattice point
    std::vector<uint32_t> owners = std::vector<uint32_t>(size_t{kCells} * kCells, 0);  ///< workers; 0: none
  };
  uint32_t TileSide(const Viewer& viewer, const Frame& frame, const Tile& area) const;
  static uint32_t OwnerOf(const Viewer& viewer, const Frame& frame, const Tile& area);
  static void SetOwner(Viewer& viewer, const Frame& frame, const Tile& area, uint32_t worker);
  double CostOf(const Viewer& viewer, const Frame& frame, const Tile& area) const;
  std::vector<FrameId> FramesWith(LiveUrgency urgency) const;
  bool GiveOwn(uint32_t id, LiveUrgency urgency, double now_s);
  bool GiveAny(uint32_t id, LiveUrgency urgency, double now_s);
  bool GiveLate(uint32_t id, double now_s);
  void Give(uint32_t id, FrameId frame_id, uint32_t number, double now_s);
  template <class GiveOne>
  void GiveInTurns(LiveUrgency urgency, GiveOne give);
  void SkipUnusedTime(Viewer& viewer) const;
  void AnnounceEnds(uint32_t id, Worker& worker);

  Sink& sink_;
  FrameId next_frame_;
  double looks_for_late_s_ = 0;  ///< when late tiles are looked for again
  std::map<uint32_t, Worker> workers_;
  std::map<uint32_t, Viewer> viewers_;
  std::map<FrameId, Frame> frames_;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "master/display/live_picture.h"
#include "master/pictures/exposure_meter.h"
#include "master/schedule/live_dispatcher.h"

namespace quarry {

/// A view that a viewer wants to see.
struct WantedView {
  View view;                       ///< normalized; without layers, of the whole image
  std::optional<double> exposure;  ///< EV; none: automatic
  uint64_t input = 0;              ///< the viewer's number and clock, which frames repeat
  double time_ms = 0;
  bool moving = false;                 ///< more views follow at once
  std::optional<ToneCurve> tone = {};  ///< none: the mode's
};

/// A viewer's settings for its views.
struct ViewSettings {
  double frame_rate = 30;  ///< wanted frames a second in motion, in [10, 60]
  uint32_t step = 0;       ///< in motion: 1, 2 or 4; 0: as fine as the frame rate allows
  bool wait = false;       ///< whether frames wait for all their pixels
  bool owners = false;     ///< whether frames name the worker of each tile
};

/// A part of a picture and the worker (id) that traced it.
struct TracedBy {
  PixelRect pixels;
  uint32_t worker = 0;
};

/// A frame to send to a viewer now.
struct DueFrame {
  WantedView wanted;
  uint32_t step = 1;   ///< side of the squares that have one traced pixel each
  uint32_t scale = 1;  ///< side of the squares that are sent as one pixel; at most `step`
  uint64_t traced = 0, waiting = 0;
  uint32_t samples = 0;
  double exposure = 0;
  double queue_s = 0, trace_s = 0;  ///< from the view's arrival to its first tile; from then on
  std::vector<PictureRows> rows;    ///< changed since the last frame; empty if exact
  std::vector<uint32_t>
      exact;               ///< all mean colours, in EncodeImage()'s form; empty unless the frame is exact
  bool in_motion = false;  ///< more follows soon
  std::vector<TracedBy> owners;
  float noise = 0;  ///< of the noisiest block; 0: not measured yet
};

/// Decides which tiles of a viewer's views are traced and which frames are sent, so that the picture never
/// freezes and becomes exact at rest.
/// - The newest view wins. It begins when a frame of the earlier view has been sent.
/// - A lattice of sample 0 comes first, of each 16th to every pixel a side, as fine as the frame rate allows.
/// It is sent when it is complete. When it is late, the coarsest one is traced before all else and sent.
/// - Then the lattice is refined, and pixels that wait for blocks are traced again. Where light bounces, all
/// this shows light that has not bounced, and no pixel is traced again.
/// - 150 ms after the last input, at once if it ends a motion, the exposure is metered, and samples
/// accumulate as exact sums. The last frame is the picture of `quarry render --view`.
/// - A viewer that does not acknowledge frames costs no tracing.
/// Units: seconds of any clock that does not go back. No sockets, no threads. Not thread-safe.
class ViewPacer {
 public:
  /// Limit of pending frames, from encoding to acknowledgement.
  static constexpr uint32_t kMostUnderWay = 2;
  /// `dispatcher` must outlive this. `viewer`: its number there.
  /// `materials`: the scene's, for the exposure. They outlive this.
  ViewPacer(LiveDispatcher& dispatcher, uint32_t viewer, std::span<const Material> materials)
      : dispatcher_(dispatcher), viewer_(viewer), materials_(materials) {}
  ~ViewPacer();
  ViewPacer(const ViewPacer&) = delete;
  ViewPacer& operator=(const ViewPacer&) = delete;

  void Want(WantedView wanted, double now_s);
  void Set(const ViewSettings& settings);
  /// The browser has drawn a frame of this viewer.
  void Acknowledged();
  /// Takes back the memory of a frame's rows.
  void Reuse(std::vector<PictureRows> rows) { picture_.Reuse(std::move(rows)); }
  /// Takes a finished tile. False: it belongs to no frame of this pacer.
  bool Take(const LiveTile& tile, std::span<const std::byte> pixels, double now_s);

  /// Continues: orders the next tiles. Returns: the frame to send now, if fewer than kMostUnderWay frames
  /// wait for acknowledgement.
  std::optional<DueFrame> Step(double now_s);
  /// The time at which Step() must be called again if nothing else happens; far in the future if none.
  double due_s() const { return due_s_; }

  /// Pixels of the picture that is held.
  uint64_t held_pixels() const { return picture_.pixels(); }
  /// Views that were overtaken before they were exact.
  uint64_t abandoned() const { return abandoned_; }
  /// The view that is traced, or null.
  const WantedView* current() const { return stage_ != Stage::kNone ? &wanted_ : nullptr; }

 private:
  /// Stages of the view that is traced. Next() has the conditions of the arrows downwards.
  ///
  ///     kNone
  ///       |  a view begins, as it may in every stage: Begin()
  ///       v
  ///     kLattice     the first lattice of sample 0 and, where it is late, the coarsest one
  ///       |  it is complete
  ///       v
  ///     kRefine      lattices of half the step, one after the other
  ///       |  each pixel is traced; or the view rests, and a step that is fine enough has no hole
  ///       v
  ///     kFill        pixels that wait for blocks, again and again
  ///       |  the view rests, and no pixel waits or holes do not close
  ///       v
  ///     kSamples <------------------------------+   ranges of samples, as exact sums
  ///       |  all are there, the exposure too    |
  ///       v                                     |
  ///     kExact ---------------------------------+   the picture of `quarry render --view`, sent once
  ///                the view is wanted again: Want()
  enum class Stage { kNone, kLattice, kRefine, kFill, kSamples, kExact };
  // Stages
  void Advance(double now_s);
  void Note(double now_s);
  Stage Next(double now_s) const;
  void Enter(Stage stage, double now_s);
  void Order(double now_s);
  // Tracing
  bool MayBegin(double now_s);
  void Begin(double now_s);
  uint32_t ChooseStep() const;
  void NoteTime(double seconds, uint64_t points);
  View TracedView() const;
  void TraceLattice(uint32_t step, uint32_t phase_x, uint32_t phase_y, LiveUrgency urgency);
  void Hurry(double now_s);
  void Refine(double now_s);
  void Fill(double now_s);
  void Meter();
  void TraceSamples();
  // Sending
  bool IsDue(double now_s);
  std::optional<DueFrame> MakeDue(double now_s);
  double ExposureNow();
  void Wake(double at_s) { due_s_ = std::min(due_s_, at_s); }

  /// A view that waits for its turn.
  struct Pending {
    WantedView wanted;
    double came_s = 0;
  };
  /// Of kLattice and kRefine.
  struct Lattice {
    uint32_t step = 1;             ///< of the finest lattice that is complete, or of the first
    uint32_t first_step = 4;       ///< of the lattice that came first
    uint32_t refining = 0;         ///< step of the lattice under way after the first; 0: none
    bool coarse_asked = false;     ///< the coarsest lattice is ordered too, because the first one is late
    std::vector<TracedBy> owners;  ///< of the first lattice's tiles
  };
  /// Of kFill; holes are noted from the first lattice on.
  struct Holes {
    std::vector<Tile> tiles;  ///< with waiting pixels
    double refill_s = 0;      ///< when they may be traced again; kept across views
    uint64_t fewest = 0;      ///< fewest waiting pixels so far
    double fewer_s = 0;       ///< when their number became that small
  };
  /// Frames that were sent of the view.
  struct Sent {
    bool any = false, exact = false;
    double at_s = 0;  ///< the last one; kept across views
  };
  /// The exposure of views. Metered for the traced view from rest on; until then that of the view before.
  struct Exposure {
    std::optional<FrameId> meter;  ///< under way
    std::vector<MeteredPoint> points;
    std::optional<double> own;   ///< metered, of this view
    std::optional<double> last;  ///< metered last
    RenderMode last_mode = RenderMode::kAo;
    std::optional<double> guess;  ///< before anything was metered
    uint64_t guessed_from = 0;    ///< pixels
  };

  LiveDispatcher& dispatcher_;
  const uint32_t viewer_;
  const std::span<const Material> materials_;
  ViewSettings settings_;
  std::optional<Pending> pending_;
  double rest_s_ = 0;  ///< when rest begins

  Stage stage_ = Stage::kNone;
  WantedView wanted_;  ///< the view that is traced
  FrameId frame_ = 0;  ///< of its tiles; none in kNone. Another one from kSamples on where light bounces
  bool sums_ = false;  ///< the frame may have sums of samples: it is of the view as wanted
  LivePicture picture_;
  double came_s_ = 0, begun_s_ = 0, traced_s_ = 0;  ///< when it arrived, was begun, and got its last tile
  Lattice lattice_;
  Holes holes_;
  Sent sent_;
  Exposure exposure_;

  double point_s_ = 0;  ///< a lattice point's share of a complete lattice's time; 0: not known
  uint32_t under_way_ = 0;
  uint64_t abandoned_ = 0;
  double due_s_ = 0;
};

}  // namespace quarry

#include "master/display/view_pacer.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/math/shared_exponent.h"

namespace quarry {
namespace {

constexpr double kNever = 1e18;
/// Seconds from the last input to rest while inputs follow each other.
constexpr double kRestS = 0.15;
/// Seconds after which a frame is sent though its lattice is not complete.
constexpr double kPatienceS = 0.06;
/// Seconds between frames of one view: while its lattice is refined or filled, and while samples accumulate.
constexpr double kRefinedEveryS = 0.04, kSampledEveryS = 0.1;
/// Seconds between attempts at pixels that wait for blocks. If their number does not fall for kStuckS, the
/// exact pass begins: workers wait for its blocks.
constexpr double kRefillS = 0.05, kStuckS = 1;
/// Seconds of rest after which the exact pass begins, whatever waits.
constexpr double kMostFillS = 3;
/// Largest share of a frame's time for its lattice, and largest expected share for a finer lattice.
constexpr double kShare = 0.85, kFinerShare = 0.65;
/// Step of the coarsest lattice: 1,200 points of a picture of 640x480, 2 to 3 ms of one core. A twentieth of
/// a core traces several a second.
constexpr uint32_t kCoarsest = 16;
/// Step of the lattice that is fine enough to continue with all pixels at rest. A coarser lattice is refined
/// first, because a starved cluster may need a minute for the first sample of all pixels.
constexpr uint32_t kRestStep = 4;
/// Seconds for a lattice of any size: messages both ways, and the wait for the last tile.
constexpr double kLatticeS = 4e-3;
/// Weight of a lattice's time in the running mean.
constexpr double kNewTime = 0.3;
/// Number of points from which an exposure is guessed.
constexpr size_t kGuessPoints = 4096;

uint64_t PointsOf(const View& view, uint32_t step) {
  return uint64_t{(view.width + step - 1) / step} * ((view.height + step - 1) / step);
}

/// The exposure from the covered pixels so far; pixels in the background's colour do not count as surfaces.
double GuessExposure(const LivePicture& picture, const View& view) {
  const uint32_t background = PackShared(view.background * std::ldexp(1.0f, view.range));
  std::vector<MeteredPoint> points;
  std::vector<uint32_t> colored;
  std::ranges::copy_if(picture.codes(), std::back_inserter(colored),
                       [](uint32_t code) { return code < kUncovered; });
  for (size_t i = 0; i < colored.size(); i += 1 + colored.size() / kGuessPoints) {
    const glm::vec3 color = UnpackShared(colored[i]);
    points.push_back({0.2126f * color.x + 0.7152f * color.y + 0.0722f * color.z,
                      std::max({color.x, color.y, color.z}), colored[i] != background});
  }
  return ExposureFor(points, 0, InfoOf(view.mode).tone) + view.range;
}

}  // namespace

ViewPacer::~ViewPacer() { dispatcher_.RemoveViewer(viewer_); }

void ViewPacer::Want(WantedView wanted, double now_s) {
  rest_s_ = now_s + (wanted.moving ? kRestS : 0);
  if (stage_ == Stage::kNone || wanted.view != wanted_.view) {
    pending_ = Pending{std::move(wanted), now_s};
    return;
  }
  // The same rays: at most its tones change.
  pending_.reset();
  const bool other_tones = wanted.exposure != wanted_.exposure || wanted.tone != wanted_.tone;
  wanted_ = std::move(wanted);
  // The same view, requested again at rest, is answered by a frame with its new input number.
  if (!other_tones && (wanted_.moving || stage_ != Stage::kExact)) return;
  picture_.Renew();
  sent_.exact = false;
  if (stage_ == Stage::kExact) Enter(Stage::kSamples, now_s);  // whose exposure may be missing
}

void ViewPacer::Set(const ViewSettings& settings) {
  const bool tells_more = settings.owners && !settings_.owners;
  settings_ = settings;
  if (!tells_more || stage_ == Stage::kNone) return;
  picture_.Renew();
  sent_.exact = false;
}

void ViewPacer::Acknowledged() {
  if (under_way_ > 0) --under_way_;
}

bool ViewPacer::Take(const LiveTile& tile, std::span<const std::byte> pixels, double now_s) {
  if (exposure_.meter && tile.frame == *exposure_.meter) {
    AddMeteredPoints(pixels, materials_, exposure_.points);
    if (dispatcher_.Wants(*exposure_.meter, LiveUrgency::kAnswer)) return true;
    dispatcher_.End(*std::exchange(exposure_.meter, std::nullopt));
    exposure_.own = exposure_.last =
        ExposureFor(exposure_.points, wanted_.view.range, InfoOf(wanted_.view.mode).tone);
    exposure_.last_mode = wanted_.view.mode;
    picture_.Renew();
    return true;
  }
  if (stage_ == Stage::kNone || tile.frame != frame_) return false;
  traced_s_ = now_s;
  if (tile.area.form == PixelForm::kShown) {
    picture_.PutShown(tile.area, pixels);
    if (picture_.Waits(tile.area)) holes_.tiles.push_back(tile.area);
    if (stage_ == Stage::kLattice && tile.area.step == lattice_.step)
      lattice_.owners.push_back({tile.area.pixels, tile.worker});
  } else {
    picture_.PutSums(tile.area, pixels);
  }
  return true;
}

std::optional<DueFrame> ViewPacer::Step(double now_s) {
  due_s_ = kNever;
  if (stage_ != Stage::kNone) Advance(now_s);
  auto due = MakeDue(now_s);
  if (pending_ && MayBegin(now_s)) Begin(now_s);
  return due;
}

// --- Stages

/// Advances through the stages as far as tiles are done, and orders the tiles of the reached stage.
void ViewPacer::Advance(double now_s) {
  for (;;) {
    if (stage_ != Stage::kLattice) {
      if (under_way_ >= kMostUnderWay) return;
      // Early: until then a view has the exposure of the view before.
      if (stage_ == Stage::kSamples || (now_s >= rest_s_ && !pending_)) Meter();
    }
    Note(now_s);
    const Stage next = Next(now_s);
    if (next == stage_) return Order(now_s);
    Enter(next, now_s);
  }
}

/// Notes the results of finished tiles.
void ViewPacer::Note(double now_s) {
  if (stage_ == Stage::kRefine && lattice_.refining != 0 && !dispatcher_.Wants(frame_, LiveUrgency::kMotion))
    lattice_.step = std::exchange(lattice_.refining, 0);
  if (stage_ == Stage::kFill && picture_.waiting() < holes_.fewest) {
    holes_.fewest = picture_.waiting();
    holes_.fewer_s = now_s;
  }
}

/// The stage that follows: the present one, or the next.
ViewPacer::Stage ViewPacer::Next(double now_s) const {
  const bool rests = now_s >= rest_s_;
  switch (stage_) {
    case Stage::kLattice:
      return dispatcher_.Wants(frame_, LiveUrgency::kMotion) ? Stage::kLattice : Stage::kRefine;
    case Stage::kRefine: {
      const bool locked = settings_.step != 0 && !rests;
      if (locked || dispatcher_.Wants(frame_, LiveUrgency::kMotion)) return Stage::kRefine;
      // The exact pass traces the pixels in between, too.
      const bool fine = rests && !pending_ && lattice_.step <= kRestStep && picture_.waiting() == 0;
      return fine || lattice_.step == 1 ? Stage::kFill : Stage::kRefine;
    }
    case Stage::kFill: {
      const bool filled = InfoOf(wanted_.view.mode).bounces || picture_.waiting() == 0 ||
                          now_s - holes_.fewer_s > kStuckS || now_s - rest_s_ > kMostFillS;
      return filled && rests ? Stage::kSamples : Stage::kFill;
    }
    case Stage::kSamples: {
      const bool all =
          picture_.open().empty() && !exposure_.meter && !dispatcher_.Wants(frame_, LiveUrgency::kRest);
      return all ? Stage::kExact : Stage::kSamples;
    }
    case Stage::kNone:
    case Stage::kExact:
      break;  // Want() leads on
  }
  return stage_;
}

/// The only place where a stage begins.
void ViewPacer::Enter(Stage stage, double now_s) {
  stage_ = stage;
  if (stage == Stage::kLattice) {
    const uint32_t step = ChooseStep();
    lattice_ = {.step = step, .first_step = step};
    holes_.tiles.clear();
    TraceLattice(step, 0, 0, LiveUrgency::kMotion);
  }
  if (stage == Stage::kSamples && !sums_) {
    dispatcher_.End(frame_);
    frame_ = dispatcher_.Begin(viewer_, wanted_.view);
    sums_ = true;
  }
  if (stage == Stage::kRefine) {
    NoteTime(traced_s_ - begun_s_, PointsOf(wanted_.view, lattice_.step));
    holes_.fewest = picture_.pixels();
    holes_.fewer_s = now_s;
  }
}

/// Orders the stage's next tiles.
void ViewPacer::Order(double now_s) {
  if (stage_ == Stage::kLattice) Hurry(now_s);
  if (stage_ == Stage::kRefine) Refine(now_s);
  if (stage_ == Stage::kFill) Fill(now_s);
  if (stage_ == Stage::kSamples) TraceSamples();
}

// --- Tracing

bool ViewPacer::MayBegin(double now_s) {
  if (stage_ == Stage::kNone) return under_way_ < kMostUnderWay;
  if (under_way_ >= kMostUnderWay || !sent_.any) return false;
  const double begins_s = begun_s_ + 1 / settings_.frame_rate - 1e-3;
  if (now_s >= begins_s) return true;
  Wake(begins_s);
  return false;
}

void ViewPacer::Begin(double now_s) {
  if (stage_ != Stage::kNone) {
    if (stage_ == Stage::kLattice) NoteTime(now_s - begun_s_, picture_.traced() + picture_.waiting());
    dispatcher_.End(frame_);
    abandoned_ += stage_ != Stage::kExact;
  }
  if (exposure_.meter) dispatcher_.End(*std::exchange(exposure_.meter, std::nullopt));
  if (wanted_.view.mode != pending_->wanted.view.mode) {
    exposure_.guess.reset();
    exposure_.guessed_from = 0;
  }
  exposure_.own.reset();
  came_s_ = pending_->came_s;
  wanted_ = std::exchange(pending_, std::nullopt)->wanted;
  const View traced = TracedView();
  sums_ = traced == wanted_.view;
  frame_ = dispatcher_.Begin(viewer_, traced);
  picture_.Open(wanted_.view);
  sent_.any = sent_.exact = false;
  begun_s_ = traced_s_ = now_s;
  Enter(Stage::kLattice, now_s);
}

uint32_t ViewPacer::ChooseStep() const {
  if (settings_.step != 0) return settings_.step;
  if (point_s_ == 0) return kCoarsest;
  for (uint32_t step = 1; step < kCoarsest; step *= 2) {
    const double share = step < lattice_.first_step ? kFinerShare : kShare;
    const double lattice_s = kLatticeS + static_cast<double>(PointsOf(wanted_.view, step)) * point_s_;
    if (lattice_s <= share / settings_.frame_rate) return step;
  }
  return kCoarsest;
}

/// Records the time that lattice points took.
void ViewPacer::NoteTime(double seconds, uint64_t points) {
  const double tracing_s = std::max({seconds - kLatticeS, seconds / 4, 1e-6});
  const double point_s = tracing_s / static_cast<double>(std::max<uint64_t>(points, 1));
  point_s_ = point_s_ == 0 ? point_s : point_s_ + kNewTime * (point_s - point_s_);
}

/// The view as it is traced until it rests: without a lens, and where light bounces without bounces.
View ViewPacer::TracedView() const {
  View view = wanted_.view;
  view.camera.aperture = 0;
  if (InfoOf(view.mode).bounces) view.bounces = 0;
  return view;
}

void ViewPacer::TraceLattice(uint32_t step, uint32_t phase_x, uint32_t phase_y, LiveUrgency urgency) {
  Tile area{wanted_.view.crop, step};
  area.phase_x = phase_x;
  area.phase_y = phase_y;
  area.samples = 1;
  area.form = PixelForm::kShown;
  area.leaves_holes = !settings_.wait;
  dispatcher_.Trace(frame_, area, urgency);
}

/// Orders the coarsest lattice before all other tiles where the first lattice is late: a coarse whole picture
/// shows more than scattered fine tiles.
void ViewPacer::Hurry(double now_s) {
  if (lattice_.coarse_asked || settings_.wait || lattice_.step == kCoarsest) return;
  if (now_s < begun_s_ + kPatienceS) return Wake(begun_s_ + kPatienceS);
  lattice_.coarse_asked = true;
  TraceLattice(kCoarsest, 0, 0, LiveUrgency::kAnswer);
}

/// Orders the points between the points of the finest lattice, unless it has done so already.
void ViewPacer::Refine(double now_s) {
  if (dispatcher_.Wants(frame_, LiveUrgency::kMotion)) return;
  if (settings_.step != 0 && now_s < rest_s_) return Wake(rest_s_);  // in motion the step is locked
  const uint32_t half = lattice_.step / 2;
  lattice_.refining = half;
  for (const auto& [x, y] : {std::pair{half, 0u}, {0u, half}, {half, half}})
    TraceLattice(lattice_.step, x, y, LiveUrgency::kMotion);
}

/// Traces tiles with waiting pixels again.
void ViewPacer::Fill(double now_s) {
  if (now_s < rest_s_) Wake(rest_s_);
  if (InfoOf(wanted_.view.mode).bounces) return;  // the samples fill them
  if (picture_.waiting() == 0 || dispatcher_.Wants(frame_, LiveUrgency::kMotion)) return;
  if (now_s < holes_.refill_s) return Wake(holes_.refill_s);
  holes_.refill_s = now_s + kRefillS;
  Wake(holes_.refill_s);
  for (const Tile& tile : std::exchange(holes_.tiles, {}))
    if (picture_.Waits(tile)) dispatcher_.Trace(frame_, tile, LiveUrgency::kMotion);
}

void ViewPacer::Meter() {
  const bool needed = !wanted_.exposure || wanted_.view.noise > 0;
  if (exposure_.meter || exposure_.own || !needed || !InfoOf(wanted_.view.mode).metered) return;
  const View view = MeteredView(wanted_.view);
  exposure_.points.clear();
  exposure_.meter = dispatcher_.Begin(viewer_, view);
  dispatcher_.Trace(*exposure_.meter, MeteredTile(view), LiveUrgency::kAnswer);
}

/// One sample first, then three times as many as there are, unless that takes long or the noise is measured
/// before: few ranges, and an early picture.
void ViewPacer::TraceSamples() {
  const uint32_t have = picture_.samples();
  if (picture_.open().empty() || dispatcher_.Wants(frame_, LiveUrgency::kRest)) return;
  if (picture_.needs_exposure()) {
    if (exposure_.meter) return;  // Take() comes first
    picture_.SetExposure(exposure_.own.value_or(0));
  }
  uint64_t pixels = 0;
  for (const PixelRect& open : picture_.open()) pixels += uint64_t{open.width} * open.height;
  Tile area;
  area.first_sample = have;
  area.samples = std::min(
      {std::max(1u, 3 * have), dispatcher_.SamplesAtOnce(viewer_, pixels), picture_.StopAfter(have) - have});
  area.form = PixelForm::kSums;
  for (const PixelRect& open : picture_.open()) {
    area.pixels = open;
    dispatcher_.Trace(frame_, area, LiveUrgency::kRest);
  }
}

// --- Sending

/// Whether the frame may be sent now.
bool ViewPacer::IsDue(double now_s) {
  if (stage_ == Stage::kNone || under_way_ >= kMostUnderWay) return false;
  if (stage_ == Stage::kExact) return !sent_.exact;
  if (!picture_.has_news()) return false;
  if (!sent_.any) {
    if (stage_ != Stage::kLattice) return true;
    // A lattice is shown as a whole, with its holes for absent blocks; the coarsest one where it was ordered.
    return lattice_.coarse_asked && !dispatcher_.Wants(frame_, LiveUrgency::kAnswer) && picture_.traced() > 0;
  }
  const double next_s = sent_.at_s + (stage_ == Stage::kSamples ? kSampledEveryS : kRefinedEveryS);
  if (now_s >= next_s) return true;
  return Wake(next_s), false;
}

std::optional<DueFrame> ViewPacer::MakeDue(double now_s) {
  if (!IsDue(now_s)) return std::nullopt;
  DueFrame due;
  due.wanted = wanted_;
  due.step = picture_.samples() > 0 ? 1 : stage_ == Stage::kLattice ? kCoarsest : lattice_.step;
  due.scale = stage_ == Stage::kSamples ? 1 : due.step;  // finished tiles show all their pixels
  due.traced = picture_.traced();
  due.waiting = picture_.waiting();
  due.samples = picture_.samples();
  due.noise = picture_.noise();
  due.exposure = ExposureNow();
  due.queue_s = begun_s_ - came_s_;
  due.trace_s = traced_s_ - begun_s_;
  due.in_motion = now_s < rest_s_ || pending_.has_value();
  if (stage_ == Stage::kExact) {
    due.exact = picture_.Means(wanted_.view.range);
    sent_.exact = true;
  } else {
    if (!sent_.any) picture_.Renew();
    due.rows = picture_.TakeNews();
  }
  if (settings_.owners) due.owners = lattice_.owners;
  sent_.any = true;
  sent_.at_s = now_s;
  ++under_way_;
  return due;
}

double ViewPacer::ExposureNow() {
  if (wanted_.exposure) return *wanted_.exposure;
  if (!InfoOf(wanted_.view.mode).metered) return 0;
  if (exposure_.own) return *exposure_.own;
  if (exposure_.last && exposure_.last_mode == wanted_.view.mode) return *exposure_.last;
  // A guess from few pixels is made again.
  if (!exposure_.guess || picture_.traced() > 2 * exposure_.guessed_from) {
    exposure_.guess = GuessExposure(picture_, wanted_.view);
    exposure_.guessed_from = std::max<uint64_t>(picture_.traced(), exposure_.guessed_from);
  }
  return *exposure_.guess;
}

}  // namespace quarry

#include "master/display/view_pacer.h"

#include <algorithm>
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
/// Seconds between attempts at pixels that wait for blocks. Without fewer of them for kStuckS, the exact pass
/// begins: it waits for blocks where they are.
constexpr double kRefillS = 0.05, kStuckS = 1;
/// Seconds of rest after which the exact pass begins, whatever waits.
constexpr double kMostFillS = 3;
/// The share of a frame's time that its lattice may take, and that a finer lattice must be expected to take.
constexpr double kShare = 0.85, kFinerShare = 0.65;
/// Step of the coarsest lattice: 1,200 points of a picture of 640x480, 2 to 3 ms of one core. A twentieth of
/// a core traces some of them a second.
constexpr uint32_t kCoarsest = 16;
/// Step of the lattice that is fine enough to go on with all pixels at rest. A coarser one is refined first,
/// for the first sample of all pixels may take a starved cluster a minute.
constexpr uint32_t kRestStep = 4;
/// Seconds that a lattice of any size takes: messages there and back, and the last tile's wait.
constexpr double kLatticeS = 4e-3;
/// Weight of a lattice's time in the running mean.
constexpr double kNewTime = 0.3;
/// Points that an exposure is guessed from.
constexpr size_t kGuessPoints = 4096;

uint64_t PointsOf(const View& view, uint32_t step) {
  return uint64_t{(view.width + step - 1) / step} * ((view.height + step - 1) / step);
}

}  // namespace

ViewPacer::~ViewPacer() { dispatcher_.RemoveViewer(viewer_); }

void ViewPacer::Want(WantedView wanted, double now_s) {
  rest_s_ = now_s + (wanted.moving ? kRestS : 0);
  if (!frame_ || wanted.view != wanted_.view) {
    pending_ = std::move(wanted);
    pending_s_ = now_s;
    return;
  }
  // The same rays: at most it is shown otherwise.
  pending_.reset();
  const bool other_exposure = wanted.exposure != wanted_.exposure;
  wanted_ = std::move(wanted);
  // Who asks again at rest is answered again, by the number of its input.
  if (!other_exposure && (wanted_.moving || stage_ != Stage::kExact)) return;
  picture_.Renew();
  exact_sent_ = false;
  if (stage_ == Stage::kExact) stage_ = Stage::kSamples;  // whose exposure may be missing
}

void ViewPacer::Set(const ViewSettings& settings) {
  const bool tells_more = settings.owners && !settings_.owners;
  settings_ = settings;
  if (!tells_more || !frame_) return;
  picture_.Renew();
  exact_sent_ = false;
}

void ViewPacer::Acknowledged() {
  if (under_way_ > 0) --under_way_;
}

bool ViewPacer::MayBegin(double now_s) {
  if (under_way_ >= kMostUnderWay || (frame_ && !sent_)) return false;
  const double begins_s = begun_s_ + 1 / settings_.frame_rate - 1e-3;
  if (!frame_ || now_s >= begins_s) return true;
  Wake(begins_s);
  return false;
}

void ViewPacer::Begin(double now_s) {
  if (frame_) {
    if (stage_ == Stage::kLattice) NoteTime(now_s - begun_s_, picture_.traced() + picture_.waiting());
    dispatcher_.End(*frame_);
    abandoned_ += stage_ != Stage::kExact;
  }
  if (meter_) dispatcher_.End(*std::exchange(meter_, std::nullopt));
  if (wanted_.view.mode != pending_->view.mode) {
    guess_.reset();
    guessed_from_ = 0;
  }
  wanted_ = *std::exchange(pending_, std::nullopt);
  frame_ = dispatcher_.Begin(viewer_, wanted_.view);
  picture_.Open(wanted_.view.width, wanted_.view.height);
  own_.reset();
  owners_.clear();
  holed_.clear();
  sent_ = exact_sent_ = false;
  came_s_ = pending_s_;
  begun_s_ = traced_s_ = now_s;
  stage_ = Stage::kLattice;
  refining_ = 0;
  coarse_asked_ = false;
  step_ = first_step_ = ChooseStep();
  TraceLattice(step_, 0, 0, LiveUrgency::kMotion);
}

uint32_t ViewPacer::ChooseStep() const {
  if (settings_.step != 0) return settings_.step;
  if (point_s_ == 0) return kCoarsest;
  for (uint32_t step = 1; step < kCoarsest; step *= 2) {
    const double share = step < first_step_ ? kFinerShare : kShare;
    const double lattice_s = kLatticeS + static_cast<double>(PointsOf(wanted_.view, step)) * point_s_;
    if (lattice_s <= share / settings_.frame_rate) return step;
  }
  return kCoarsest;
}

/// Notes how long lattice points took.
void ViewPacer::NoteTime(double seconds, uint64_t points) {
  const double tracing_s = std::max({seconds - kLatticeS, seconds / 4, 1e-6});
  const double point_s = tracing_s / static_cast<double>(std::max<uint64_t>(points, 1));
  point_s_ = point_s_ == 0 ? point_s : point_s_ + kNewTime * (point_s - point_s_);
}

void ViewPacer::TraceLattice(uint32_t step, uint32_t phase_x, uint32_t phase_y, LiveUrgency urgency) {
  Tile area{wanted_.view.crop, step};
  area.phase_x = phase_x;
  area.phase_y = phase_y;
  area.samples = 1;
  area.form = PixelForm::kShown;
  area.leaves_holes = !settings_.wait;
  dispatcher_.Trace(*frame_, area, urgency);
}

/// Asks for the coarsest lattice, before all other tiles, where the first lattice is late: tiles here and
/// there say less than a coarse picture of all.
void ViewPacer::Hurry(double now_s) {
  if (coarse_asked_ || settings_.wait || stage_ != Stage::kLattice || step_ == kCoarsest) return;
  if (now_s < begun_s_ + kPatienceS) return Wake(begun_s_ + kPatienceS);
  coarse_asked_ = true;
  TraceLattice(kCoarsest, 0, 0, LiveUrgency::kAnswer);
}

bool ViewPacer::Take(const LiveTile& tile, std::span<const std::byte> pixels, double now_s) {
  if (meter_ && tile.frame == *meter_) {
    AddMeteredPoints(pixels, materials_, metered_);
    if (dispatcher_.Wants(*meter_, LiveUrgency::kAnswer)) return true;
    dispatcher_.End(*std::exchange(meter_, std::nullopt));
    own_ = exposure_ = ExposureFor(metered_);
    exposed_mode_ = wanted_.view.mode;
    picture_.Renew();
    return true;
  }
  if (!frame_ || tile.frame != *frame_) return false;
  traced_s_ = now_s;
  if (tile.area.form == PixelForm::kShown) {
    picture_.PutShown(tile.area, pixels);
    if (picture_.Waits(tile.area)) holed_.push_back(tile.area);
    if (stage_ == Stage::kLattice && tile.area.step == step_)
      owners_.push_back({tile.area.pixels, tile.worker});
  } else {
    picture_.PutSums(tile.area, pixels);
  }
  return true;
}

std::optional<DueFrame> ViewPacer::Step(double now_s) {
  due_s_ = kNever;
  if (frame_) Advance(now_s);
  auto due = MakeDue(now_s);
  if (pending_ && MayBegin(now_s)) Begin(now_s);
  return due;
}

/// Goes through the stages as far as tiles are done.
void ViewPacer::Advance(double now_s) {
  if (stage_ == Stage::kLattice) {
    if (dispatcher_.Wants(*frame_, LiveUrgency::kMotion)) return Hurry(now_s);
    NoteTime(traced_s_ - begun_s_, PointsOf(wanted_.view, step_));
    stage_ = Stage::kRefine;
    fewest_waiting_ = picture_.pixels();
    fewer_s_ = now_s;
  }
  if (under_way_ >= kMostUnderWay) return;
  // Early: until then a view is exposed as the one before was.
  if (now_s >= rest_s_ && !pending_) Meter();
  if (stage_ == Stage::kRefine) Refine(now_s);
  if (stage_ == Stage::kFill) Fill(now_s);
  if (stage_ == Stage::kSamples) NextSamples();
}

void ViewPacer::Refine(double now_s) {
  if (dispatcher_.Wants(*frame_, LiveUrgency::kMotion)) return;
  if (refining_ != 0) step_ = std::exchange(refining_, 0);
  const bool rests = now_s >= rest_s_ && !pending_;
  if (settings_.step != 0 && now_s < rest_s_) return Wake(rest_s_);  // in motion the step is locked
  if (step_ == 1 || (rests && step_ <= kRestStep && picture_.waiting() == 0)) {
    stage_ = Stage::kFill;  // the exact pass brings the pixels between, too
    return;
  }
  refining_ = step_ / 2;
  for (const auto& [x, y] : {std::pair{refining_, 0u}, {0u, refining_}, {refining_, refining_}})
    TraceLattice(step_, x, y, LiveUrgency::kMotion);
}

/// Traces tiles with waiting pixels again, until rest begins and none waits.
void ViewPacer::Fill(double now_s) {
  if (picture_.waiting() < fewest_waiting_) {
    fewest_waiting_ = picture_.waiting();
    fewer_s_ = now_s;
  }
  const bool filled = picture_.waiting() == 0 || now_s - fewer_s_ > kStuckS || now_s - rest_s_ > kMostFillS;
  if (filled && now_s >= rest_s_) {
    stage_ = Stage::kSamples;
    return;
  }
  if (now_s < rest_s_) Wake(rest_s_);
  if (picture_.waiting() == 0 || dispatcher_.Wants(*frame_, LiveUrgency::kMotion)) return;
  if (now_s < refill_s_) return Wake(refill_s_);
  refill_s_ = now_s + kRefillS;
  Wake(refill_s_);
  for (const Tile& tile : std::exchange(holed_, {}))
    if (picture_.Waits(tile)) dispatcher_.Trace(*frame_, tile, LiveUrgency::kMotion);
}

void ViewPacer::Meter() {
  if (meter_ || own_ || wanted_.exposure || !InfoOf(wanted_.view.mode).metered) return;
  const View view = MeteredView(wanted_.view);
  metered_.clear();
  meter_ = dispatcher_.Begin(viewer_, view);
  dispatcher_.Trace(*meter_, MeteredTile(view), LiveUrgency::kAnswer);
}

/// One sample first, then three times as many as there are: few ranges, and something to see early.
void ViewPacer::NextSamples() {
  Meter();
  if (dispatcher_.Wants(*frame_, LiveUrgency::kRest)) return;
  const uint32_t have = picture_.samples(), all = wanted_.view.spp;
  if (have == all) {
    if (!meter_) stage_ = Stage::kExact;
    return;
  }
  Tile area{wanted_.view.crop};
  area.first_sample = have;
  area.samples = std::min({std::max(1u, 3 * have), dispatcher_.SamplesAtOnce(viewer_), all - have});
  area.form = PixelForm::kSums;
  dispatcher_.Trace(*frame_, area, LiveUrgency::kRest);
}

/// Whether the frame may be sent now.
bool ViewPacer::IsDue(double now_s) {
  if (!frame_ || under_way_ >= kMostUnderWay) return false;
  if (stage_ == Stage::kExact) return !exact_sent_;
  if (!picture_.has_news()) return false;
  if (!sent_) {
    // A lattice is shown whole, its holes for absent blocks included.
    return stage_ != Stage::kLattice || (HasCoarse() && picture_.traced() > 0);
  }
  const double next_s = sent_s_ + (stage_ == Stage::kSamples ? kSampledEveryS : kRefinedEveryS);
  if (now_s >= next_s) return true;
  return Wake(next_s), false;
}

/// Whether the coarsest lattice, which was asked for since the first one is late, is complete.
bool ViewPacer::HasCoarse() const {
  return coarse_asked_ && !dispatcher_.Wants(*frame_, LiveUrgency::kAnswer);
}

std::optional<DueFrame> ViewPacer::MakeDue(double now_s) {
  if (!IsDue(now_s)) return std::nullopt;
  DueFrame due;
  due.wanted = wanted_;
  due.step = picture_.samples() > 0 ? 1 : stage_ == Stage::kLattice ? kCoarsest : step_;
  due.scale = stage_ == Stage::kSamples ? 1 : due.step;  // finished tiles show all their pixels
  due.traced = picture_.traced();
  due.waiting = picture_.waiting();
  due.samples = picture_.samples();
  due.exposure = ExposureNow();
  due.queue_s = begun_s_ - came_s_;
  due.trace_s = traced_s_ - begun_s_;
  due.in_motion = now_s < rest_s_ || pending_.has_value();
  if (stage_ == Stage::kExact) {
    due.exact = picture_.Means();
    exact_sent_ = true;
  } else {
    if (!sent_) picture_.Renew();
    due.rows = picture_.TakeNews();
  }
  if (settings_.owners) due.owners = owners_;
  sent_ = true;
  sent_s_ = now_s;
  ++under_way_;
  return due;
}

double ViewPacer::ExposureNow() {
  if (wanted_.exposure) return *wanted_.exposure;
  if (!InfoOf(wanted_.view.mode).metered) return 0;
  if (own_) return *own_;
  if (exposure_ && exposed_mode_ == wanted_.view.mode) return *exposure_;
  // A guess from few pixels is made again.
  if (!guess_ || picture_.traced() > 2 * guessed_from_) {
    guess_ = GuessExposure();
    guessed_from_ = std::max<uint64_t>(picture_.traced(), guessed_from_);
  }
  return *guess_;
}

/// The exposure by the pixels at hand that are covered, of which those in the background's colour count as no
/// surface.
double ViewPacer::GuessExposure() const {
  const uint32_t background = PackShared(wanted_.view.background);
  std::vector<MeteredPoint> points;
  const auto& codes = picture_.codes();
  std::vector<uint32_t> colored;
  std::ranges::copy_if(codes, std::back_inserter(colored), [](uint32_t code) { return code < kUncovered; });
  for (size_t i = 0; i < colored.size(); i += 1 + colored.size() / kGuessPoints) {
    const glm::vec3 color = UnpackShared(colored[i]);
    points.push_back({0.2126f * color.x + 0.7152f * color.y + 0.0722f * color.z,
                      std::max({color.x, color.y, color.z}), colored[i] != background});
  }
  return ExposureFor(points);
}

}  // namespace quarry

#include "master/schedule/live_dispatcher.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace quarry {
namespace {

/// Time that computing a tile should take: ten times its other costs (130 to 200 us), and a tenth of a frame.
constexpr double kTileS = 2e-3;
/// Computing of the smallest tile of a range of samples: a viewer in motion waits for no longer one.
constexpr double kRestTileS = 10e-3;
/// Time of a range of samples of a whole picture.
constexpr double kRestRangeS = 0.25;
/// Tiles per thread, one begun and one queued: the next is there when one ends.
constexpr uint32_t kTilesPerThread = 2;
/// Seconds after which a held tile is given to an idle worker too, doubled with each holder. A tile that
/// leaves holes waits for no block, so that only a lost or slow worker is late with it.
constexpr double kLateS = 0.25, kLateWithBlocksS = 3;
/// Lattice points a side of a tile; packets have eight.
constexpr uint32_t kPacket = 8, kLeastSide = 16, kMostSide = 128;
/// Open tiles among which a worker's own is looked for: a large picture at rest has thousands.
constexpr size_t kLookAhead = 256;
/// Weight of a tile's cost in the running mean.
constexpr double kNewCost = 0.2;

}  // namespace

bool LiveDispatcher::Worker::MayHave(LiveUrgency urgency) const {
  // A picture at rest leaves each thread a tile for somebody else's in motion.
  return held < threads * (urgency == LiveUrgency::kRest ? kTilesPerThread - 1 : kTilesPerThread);
}

void LiveDispatcher::AddWorker(uint32_t id, uint32_t threads) {
  workers_.emplace(id, Worker{.threads = threads});
}

void LiveDispatcher::RemoveWorker(uint32_t id) {
  if (workers_.erase(id) == 0) return;
  for (auto& [frame_id, frame] : frames_)
    for (const uint32_t number : frame.leases.Forget(id))
      if (frame.leases.Of(number).empty())
        frame.open[static_cast<size_t>(frame.tiles.at(number).urgency)].push_front(number);
}

uint32_t LiveDispatcher::threads() const {
  uint32_t threads = 0;
  for (const auto& [id, worker] : workers_) threads += worker.threads;
  return threads;
}

FrameId LiveDispatcher::Begin(uint32_t viewer, const View& view) {
  Viewer& of = viewers_[viewer];
  SkipUnusedTime(of);
  const FrameId id = next_frame_++;
  frames_.emplace(id, Frame{.viewer = viewer, .view = view});
  return id;
}

/// A viewer that has been idle does not get the time that it has not used.
void LiveDispatcher::SkipUnusedTime(Viewer& viewer) const {
  double least_s = 1e300;
  for (const auto& [id, frame] : frames_)
    if (!frame.tiles.empty()) least_s = std::min(least_s, viewers_.at(frame.viewer).used_s);
  if (least_s < 1e300) viewer.used_s = std::max(viewer.used_s, least_s);
}

void LiveDispatcher::End(FrameId id) {
  const auto it = frames_.find(id);
  if (it == frames_.end()) return;
  it->second.leases.ForEach([&](uint32_t, const TileLease& lease) { --workers_.at(lease.worker).held; });
  frames_.erase(it);
  for (auto& [worker_id, worker] : workers_)
    if (worker.announced.erase(id) > 0) worker.ended.push_back(id);
}

void LiveDispatcher::RemoveViewer(uint32_t viewer) {
  std::vector<FrameId> its;
  for (const auto& [id, frame] : frames_)
    if (frame.viewer == viewer) its.push_back(id);
  for (const FrameId id : its) End(id);
  viewers_.erase(viewer);
}

double LiveDispatcher::CostOf(const Viewer& viewer, const Frame& frame, const Tile& area) const {
  return viewer.point_s * area.columns() * area.rows() * area.samples_of(frame.view.spp);
}

/// Lattice points a side of the tiles that an area is cut into.
uint32_t LiveDispatcher::TileSide(const Viewer& viewer, const Frame& frame, const Tile& area) const {
  const double point_s = viewer.point_s * area.samples_of(frame.view.spp);
  const double points = static_cast<double>(area.columns()) * area.rows();
  // Enough tiles for all threads, too.
  const double most = std::min(kTileS / point_s, points / (2.0 * std::max(threads(), 1u)));
  auto side = static_cast<uint32_t>(std::sqrt(std::max(most, 1.0))) / kPacket * kPacket;
  side = std::clamp(side, kLeastSide, kMostSide);
  if (area.form == PixelForm::kMeans)
    side = std::min(side, kTileSize);  // with depths and blocks, as jobs' tiles
  const size_t bytes = BytesPerPoint(area.form, frame.view.aov_mask);
  while (size_t{side} * side * bytes > kMaxTileBytes) side -= kPacket;
  return side;
}

void LiveDispatcher::Trace(FrameId id, const Tile& area, LiveUrgency urgency) {
  Frame& frame = frames_.at(id);
  const uint32_t side = TileSide(viewers_.at(frame.viewer), frame, area) * area.step;
  for (uint32_t y = 0; y < area.pixels.height; y += side)
    for (uint32_t x = 0; x < area.pixels.width; x += side) {
      Tile part = area;
      part.pixels = {area.pixels.x + x, area.pixels.y + y, std::min(side, area.pixels.width - x),
                     std::min(side, area.pixels.height - y)};
      if (part.columns() == 0 || part.rows() == 0) continue;
      const uint32_t number = frame.next_tile++;
      frame.tiles.emplace(number, Wanted{.area = part, .urgency = urgency});
      frame.open[static_cast<size_t>(urgency)].push_back(number);
      ++frame.unfinished[static_cast<size_t>(urgency)];
    }
}

uint32_t LiveDispatcher::SamplesAtOnce(uint32_t viewer, uint64_t pixels) const {
  const auto it = viewers_.find(viewer);
  const double point_s = it == viewers_.end() ? Viewer().point_s : it->second.point_s;
  const double of_tile = kRestTileS / (point_s * kLeastSide * kLeastSide);
  const double of_picture = kRestRangeS * std::max(threads(), 1u) / (point_s * static_cast<double>(pixels));
  return static_cast<uint32_t>(std::clamp(std::min(of_tile, of_picture), 1.0, 65536.0));
}

bool LiveDispatcher::Holds(uint32_t worker, FrameId id) const {
  const auto it = frames_.find(id);
  bool holds = false;
  if (it != frames_.end())
    it->second.leases.ForEach([&](uint32_t, const TileLease& lease) { holds |= lease.worker == worker; });
  return holds;
}

bool LiveDispatcher::Wants(FrameId id, LiveUrgency urgency) const {
  const auto it = frames_.find(id);
  return it != frames_.end() && it->second.unfinished[static_cast<size_t>(urgency)] > 0;
}

/// The worker that traced the middle of an area last; 0: none.
uint32_t LiveDispatcher::OwnerOf(const Viewer& viewer, const Frame& frame, const Tile& area) {
  const PixelRect& p = area.pixels;
  const uint64_t x = (p.x + p.width / 2) * uint64_t{kCells} / frame.view.width;
  const uint64_t y = (p.y + p.height / 2) * uint64_t{kCells} / frame.view.height;
  return viewer.owners[y * kCells + x];
}

void LiveDispatcher::SetOwner(Viewer& viewer, const Frame& frame, const Tile& area, uint32_t worker) {
  const PixelRect& p = area.pixels;
  const auto cell = [](uint32_t at, uint32_t length) { return uint64_t{at} * kCells / length; };
  const View& view = frame.view;
  for (uint64_t y = cell(p.y, view.height); y <= cell(p.y + p.height - 1, view.height); ++y)
    for (uint64_t x = cell(p.x, view.width); x <= cell(p.x + p.width - 1, view.width); ++x)
      viewer.owners[y * kCells + x] = worker;
}

/// The frames that have open tiles of an urgency, first the frames of the viewer that has got least time.
std::vector<FrameId> LiveDispatcher::FramesWith(LiveUrgency urgency) const {
  std::vector<std::pair<double, FrameId>> found;
  for (const auto& [id, frame] : frames_)
    if (!frame.open[static_cast<size_t>(urgency)].empty())
      found.emplace_back(viewers_.at(frame.viewer).used_s, id);
  std::ranges::sort(found);
  std::vector<FrameId> ids;
  for (const auto& [used_s, id] : found) ids.push_back(id);
  return ids;
}

void LiveDispatcher::Give(uint32_t id, FrameId frame_id, uint32_t number, double now_s) {
  Worker& worker = workers_.at(id);
  Frame& frame = frames_.at(frame_id);
  Viewer& viewer = viewers_.at(frame.viewer);
  const Wanted& tile = frame.tiles.at(number);
  if (worker.announced.insert(frame_id).second) sink_.SetUp(id, frame_id, frame.view);
  ++worker.held;
  viewer.used_s += CostOf(viewer, frame, tile.area);
  TileOrder order{frame_id, number, frame.leases.Give(number, id, now_s), tile.area};
  order.urgency = tile.urgency == LiveUrgency::kRest ? Urgency::kRest : Urgency::kMotion;
  sink_.Order(id, std::move(order));
}

/// Gives a worker a tile where it traced before, or where nobody did.
bool LiveDispatcher::GiveOwn(uint32_t id, LiveUrgency urgency, double now_s) {
  for (const FrameId frame_id : FramesWith(urgency)) {
    Frame& frame = frames_.at(frame_id);
    Viewer& viewer = viewers_.at(frame.viewer);
    auto& open = frame.open[static_cast<size_t>(urgency)];
    const auto end = open.begin() + static_cast<std::ptrdiff_t>(std::min(open.size(), kLookAhead));
    const auto mine = std::find_if(open.begin(), end, [&](uint32_t number) {
      const uint32_t owner = OwnerOf(viewer, frame, frame.tiles.at(number).area);
      return owner == id || !workers_.contains(owner);
    });
    if (mine == end) continue;
    const uint32_t number = *mine;
    open.erase(mine);
    SetOwner(viewer, frame, frame.tiles.at(number).area, id);
    Give(id, frame_id, number, now_s);
    return true;
  }
  return false;
}

/// Gives a worker a tile of a worker that has its hands full.
bool LiveDispatcher::GiveAny(uint32_t id, LiveUrgency urgency, double now_s) {
  const auto frames = FramesWith(urgency);
  if (frames.empty()) return false;
  auto& open = frames_.at(frames.front()).open[static_cast<size_t>(urgency)];
  const uint32_t number = open.back();
  open.pop_back();
  Give(id, frames.front(), number, now_s);
  return true;
}

/// Gives an idle worker a tile that another one is late with.
bool LiveDispatcher::GiveLate(uint32_t id, double now_s) {
  for (auto& [frame_id, its_frame] : frames_) {
    Frame& frame = its_frame;  // clang 14 captures no binding
    const auto after_s = [&](uint32_t number) {
      return frame.tiles.at(number).area.leaves_holes ? kLateS : kLateWithBlocksS;
    };
    for (const uint32_t number : frame.leases.Late(now_s, after_s, [](uint32_t) { return true; })) {
      if (frame.leases.Of(number).size() >= kMostLiveHolders || frame.leases.Holds(id, number)) continue;
      Give(id, frame_id, number, now_s);
      return true;
    }
  }
  return false;
}

/// Gives workers tiles one by one, each in its turn, while they have room.
template <class GiveOne>
void LiveDispatcher::GiveInTurns(LiveUrgency urgency, GiveOne give) {
  for (bool any = true; any;) {
    any = false;
    for (auto& [id, worker] : workers_)
      if (worker.MayHave(urgency)) any = give(id) || any;
  }
}

void LiveDispatcher::AnnounceEnds(uint32_t id, Worker& worker) {
  for (auto ended = std::exchange(worker.ended, {}); !ended.empty();) {
    const size_t some = std::min(ended.size(), kMaxFramesEnded);
    sink_.End(id, {ended.end() - static_cast<std::ptrdiff_t>(some), ended.end()});
    ended.resize(ended.size() - some);
  }
}

void LiveDispatcher::DismissWorker(uint32_t id) {
  const auto it = workers_.find(id);
  if (it == workers_.end()) return;
  Worker& worker = it->second;
  worker.ended.insert(worker.ended.end(), worker.announced.begin(), worker.announced.end());
  AnnounceEnds(id, worker);
  RemoveWorker(id);
}

void LiveDispatcher::Assign(double now_s) {
  for (auto& [id, worker] : workers_) AnnounceEnds(id, worker);
  for (const auto urgency : {LiveUrgency::kAnswer, LiveUrgency::kMotion, LiveUrgency::kRest}) {
    GiveInTurns(urgency, [&](uint32_t id) { return GiveOwn(id, urgency, now_s); });
    GiveInTurns(urgency, [&](uint32_t id) { return GiveAny(id, urgency, now_s); });
  }
  if (now_s < looks_for_late_s_) return;
  looks_for_late_s_ = now_s + kLateS / 4;
  GiveInTurns(LiveUrgency::kMotion, [&](uint32_t id) { return GiveLate(id, now_s); });
}

Result<std::optional<LiveTile>> LiveDispatcher::Finish(uint32_t worker, const TileDone& done,
                                                       size_t pixel_bytes) {
  const auto it = frames_.find(done.frame);
  if (it == frames_.end()) return std::optional<LiveTile>();
  Frame& frame = it->second;
  const TileLease* lease = frame.leases.Find(done.tile, done.lease);
  if (!lease || lease->worker != worker) return std::optional<LiveTile>();
  const auto tile = frame.tiles.find(done.tile);
  const Tile area = tile->second.area;
  const LiveTile traced{done.frame, frame.viewer, area, worker, done.rays};
  const size_t points = size_t{area.columns()} * area.rows();
  if (pixel_bytes != points * BytesPerPoint(area.form, frame.view.aov_mask))
    return Fail(fmt::format("a tile has {} bytes of pixels, which do not fit its size", pixel_bytes));
  for (const TileLease& held : frame.leases.Of(done.tile)) --workers_.at(held.worker).held;
  frame.leases.EndAll(done.tile);
  --frame.unfinished[static_cast<size_t>(tile->second.urgency)];
  frame.tiles.erase(tile);
  Viewer& viewer = viewers_.at(frame.viewer);
  SetOwner(viewer, frame, area, worker);
  if (points < kLeastSide * kLeastSide) return std::optional(traced);
  // The worker's word for its time is believed within bounds. A few points are no evidence.
  const double point_s = static_cast<double>(done.compute_us) * 1e-6 /
                         (static_cast<double>(points) * area.samples_of(frame.view.spp));
  viewer.point_s += kNewCost * (std::clamp(point_s, 1e-8, 1e-3) - viewer.point_s);
  return std::optional(traced);
}

}  // namespace quarry

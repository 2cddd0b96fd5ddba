#include "common/engine/engine.h"

#include <algorithm>
#include <chrono>
#include <new>
#include <utility>

#include "common/base/resource.h"

namespace quarry {
namespace {

constexpr int kBatchesPerPin =
    8;  // batches between releases of pins, even while rays are ready; a pinned block cannot be evicted

}  // namespace

Engine::Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads, OnFault on_fault)
    : catalog_(catalog),
      cache_(cache),
      on_fault_(std::move(on_fault)),
      surfaces_(std::make_shared<const SceneSurfaces>(catalog)),
      queue_depth_(threads) {
  for (unsigned i = 0; i < threads; ++i) mailboxes_.push_back(std::make_unique<Mailbox>());
  try {
    for (auto& mailbox : mailboxes_) threads_.emplace_back([this, &mailbox] { Run(*mailbox); });
  } catch (...) {  // The system refuses a thread: the running ones end before the error leaves.
    Stop();
    throw;
  }
}

Engine::~Engine() { Stop(); }

void Engine::Stop() {
  stop_ = true;
  WakeAll();
  for (std::thread& thread : threads_) thread.join();
}

void Engine::WakeAll() {
  for (auto& mailbox : mailboxes_) mailbox->Wake();
}

void Engine::SetView(uint64_t number, const View& view, std::shared_ptr<const Integrator> integrator) {
  std::unique_lock lock(mutex_);
  auto shown = ShownOf(view.parts);
  lock.unlock();  // threads go on while the view's lights are made ready
  auto context = std::make_shared<ViewContext>(
      view, catalog_, surfaces_, std::move(integrator), std::move(shown),
      cache_.slots().FindEnvironment(view.environment.id).value_or(EnvironmentPages{}));
  lock.lock();
  views_[number] = std::move(context);
}

/// The view's selection, made ready once for all views that have it. Requires: mutex_ is held.
std::shared_ptr<const ShownParts> Engine::ShownOf(const ViewParts& parts) {
  if (!parts.selection) return nullptr;
  std::erase_if(shown_, [](const auto& known) { return known.second.expired(); });
  std::weak_ptr<const ShownParts>& known = shown_[parts.id()];
  if (auto shown = known.lock()) return shown;
  auto made = std::make_shared<const ShownParts>(catalog_, parts.selection);
  known = made;
  return made;
}

void Engine::DropViews(uint64_t first, uint64_t end) {
  {
    const std::lock_guard lock(mutex_);
    const auto from = views_.lower_bound(first), to = views_.lower_bound(end);
    if (from == to) return;
    for (auto it = from; it != to; ++it) it->second->abandoned = true;
    views_.erase(from, to);
    for (auto& queue : queues_)
      std::erase_if(queue, [&](const Queued& q) { return !views_.contains(q.view); });
    NoteQueued();
  }
  WakeAll();
}

Status Engine::Render(uint64_t view, const Tile& tile, OnTile done, Urgency urgency) {
  {
    const std::lock_guard lock(mutex_);
    const auto of = views_.find(view);
    if (of == views_.end()) return {};
    QUARRY_TRY(CheckTile(tile, of->second->view));
    Queue({view, tile, std::move(done), urgency});
  }
  WakeAll();
  return {};
}

void Engine::Trace(uint64_t view, RayPart part, OnTile done, Urgency urgency) {
  {
    const std::lock_guard lock(mutex_);
    if (!views_.contains(view)) return;
    Queue({view, std::move(part), std::move(done), urgency});
  }
  WakeAll();
}

/// Requires: mutex_ is held.
void Engine::Queue(Queued next) {
  queues_[static_cast<size_t>(next.urgency)].push_back(std::move(next));
  NoteQueued();
}

void Engine::GiveBackQueued() {
  std::vector<OnTile> unbegun;
  {
    const std::lock_guard lock(mutex_);
    for (auto& queue : queues_) {
      for (Queued& tile : queue) unbegun.push_back(std::move(tile.done));
      queue.clear();
    }
    NoteQueued();
  }
  for (const OnTile& done : unbegun) done({.begun = false});
}

/// Requires: mutex_ is held.
void Engine::NoteQueued() {
  int most = kUrgencies - 1;
  while (most >= 0 && queues_[static_cast<size_t>(most)].empty()) --most;
  queued_ = most;
}

/// The highest urgency among the open tiles; with `ready`, among the open tiles that can go on. -1: there are
/// none.
int Engine::MostUrgent(const Tiles& tiles, bool ready) {
  int most = -1;
  for (const auto& tile : tiles.open)
    if (!ready || tile.ready()) most = std::max(most, static_cast<int>(tile.urgency));
  return most;
}

bool Engine::MayOpen(const Tiles& tiles) const {
  if (tiles.open.empty()) return true;
  if (tiles.open.size() >= kMostOpenTiles && !cache_.scarce()) return false;
  return tiles.open.back().renderer->memory_bytes() * (tiles.open.size() + 1) <= TileBytes();
}

/// Opens a queued tile of this urgency or a higher one.
bool Engine::OpenTile(Tiles& tiles, int least) {
  std::shared_ptr<const ViewContext> view;
  Queued next;
  {
    const std::lock_guard lock(mutex_);
    if (queued_ < least) {
      if (least == 0 && !tiles.open.empty()) queue_depth_.Starved(cache_.scarce());
      return false;
    }
    auto& queue = queues_[static_cast<size_t>(queued_.load())];
    next = std::move(queue.front());
    queue.pop_front();
    ++open_;
    NoteQueued();
    view = views_.at(next.view);
  }
  if (tiles.spare.empty()) tiles.spare.push_back(std::make_unique<TileRenderer>());
  tiles.open.push_back({std::move(tiles.spare.back()), std::move(next.done), next.urgency});
  tiles.spare.pop_back();
  TileRenderer& renderer = *tiles.open.back().renderer;
  std::visit([&](auto& what) { renderer.Open(std::move(view), std::move(what)); }, next.what);
  return true;
}

/// Hands on the results of finished tiles, and closes abandoned tiles without a result.
void Engine::CloseTiles(Tiles& tiles) {
  for (size_t i = 0; i < tiles.open.size();) {
    Tiles::Open& open = tiles.open[i];
    const bool abandoned = open.renderer->view().abandoned;
    if (!abandoned && !open.renderer->done() && !open.renderer->may_leave_holes()) {
      ++i;
      continue;
    }
    if (abandoned) open.renderer->Abandon();
    if (!abandoned && !open.renderer->done()) open.renderer->LeaveHoles();
    RenderedTile result = open.renderer->Take();
    result.compute_us = open.compute_us;
    rays_ += result.rays;
    rays_suspended_ += result.rays_suspended;
    if (open.urgency == Urgency::kJob) {
      const std::lock_guard lock(mutex_);
      queue_depth_.Finished();
    }
    if (!abandoned) open.done(std::move(result));
    --open_;
    tiles.spare.push_back(std::move(open.renderer));
    tiles.open.erase(tiles.open.begin() + static_cast<std::ptrdiff_t>(i));
  }
}

/// Takes delivered blocks. With `wait`, sleeps until there is something to do; `stalled` means that the
/// thread has open tiles, so that the wait is for blocks.
std::vector<BlockKey> Engine::TakeBlocks(Mailbox& mailbox, bool wait, bool stalled) {
  const auto start = std::chrono::steady_clock::now();
  auto blocks = mailbox.Take(wait);
  if (wait && stalled) stall_us_ += MicrosecondsSince(start);
  return blocks;
}

/// Steps the open tiles that have ready rays: the most urgent of them.
void Engine::Step(Tiles& tiles, PinnedBlocks& pins, Mailbox& mailbox) {
  const uint64_t start_us = ThreadTimeUs();
  const int most = MostUrgent(tiles, true);
  for (auto& tile : tiles.open) {
    if (!tile.ready() || static_cast<int>(tile.urgency) < most) continue;
    const auto start = std::chrono::steady_clock::now();
    tile.renderer->Step(pins, [&](BlockKey block, const RayBatch::Parked& parked) {
      cache_.Want(block, &mailbox, parked.rays, parked.octants);
    });
    // Wall time, since a shared or throttled processor makes a tile slower.
    tile.compute_us += MicrosecondsSince(start);
  }
  compute_us_ += ThreadTimeUs() - start_us;
}

/// A failed allocation ends this thread's work, not the program.
void Engine::Run(Mailbox& mailbox) {
  Tiles tiles;
  try {
    return Work(mailbox, tiles);
  } catch (const std::bad_alloc&) {
  }
  open_ -= static_cast<uint32_t>(tiles.open.size());
  tiles = {};  // returns memory before the fault is reported
  if (on_fault_) on_fault_();
}

void Engine::Work(Mailbox& mailbox, Tiles& tiles) {
  PinnedBlocks pins(cache_);
  for (int batch = 0; !stop_; ++batch) {
    CloseTiles(tiles);
    const int going = MostUrgent(tiles, true);
    bool ready = going >= 0;
    // A more urgent tile than all that are open finds room beside them.
    const int least = MayOpen(tiles) ? going + 1 : MostUrgent(tiles, false) + 1;
    if (queued_ >= least || !ready) ready = OpenTile(tiles, least) || ready;
    // A waiting thread holds no pins: another thread's block may need the room.
    if (!ready || batch % kBatchesPerPin == 0) pins.Release();
    for (const BlockKey block : TakeBlocks(mailbox, !ready, !tiles.open.empty())) {
      pins.Adopt(block);
      for (auto& tile : tiles.open) tile.renderer->Resume(block);
    }
    Step(tiles, pins, mailbox);
  }
}

}  // namespace quarry

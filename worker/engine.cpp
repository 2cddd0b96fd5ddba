#include "worker/engine.h"

#include <utility>

namespace quarry {
namespace {

constexpr int kBatchesPerPinSet = 8;  // pins are let go after so many batches, used up or not

}  // namespace

Engine::Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads, OnTile on_tile)
    : catalog_(catalog), cache_(cache), on_tile_(std::move(on_tile)) {
  for (unsigned i = 0; i < threads; ++i) mailboxes_.push_back(std::make_unique<Mailbox>());
  for (auto& mailbox : mailboxes_) threads_.emplace_back([this, &mailbox] { Run(*mailbox); });
}

Engine::~Engine() {
  stop_ = true;
  for (auto& mailbox : mailboxes_) mailbox->Wake();
  for (std::thread& thread : threads_) thread.join();
}

void Engine::SetFrame(const FrameSetup& setup) {
  const std::lock_guard lock(mutex_);
  frame_ = std::make_shared<const FrameContext>(setup.setup, setup.job, catalog_);
  queue_.clear();
}

void Engine::AddTile(const TileOrder& order) {
  {
    const std::lock_guard lock(mutex_);
    if (!frame_ || frame_->setup != order.setup) return;
    queue_.push_back(order);
  }
  for (auto& mailbox : mailboxes_) mailbox->Wake();
}

void Engine::DropTiles() {
  const std::lock_guard lock(mutex_);
  queue_.clear();
}

bool Engine::OpenTile(Tiles& tiles) {
  std::shared_ptr<const FrameContext> frame;
  TileOrder order;
  {
    const std::lock_guard lock(mutex_);
    if (queue_.empty()) return false;
    order = queue_.front();
    queue_.pop_front();
    frame = frame_;
  }
  if (tiles.spare.empty()) tiles.spare.push_back(std::make_unique<TileRenderer>());
  tiles.open.push_back(std::move(tiles.spare.back()));
  tiles.spare.pop_back();
  tiles.open.back()->Open(std::move(frame), order);
  return true;
}

void Engine::FinishTiles(Tiles& tiles) {
  for (size_t i = 0; i < tiles.open.size();) {
    TileRenderer& tile = *tiles.open[i];
    if (!tile.done()) {
      ++i;
      continue;
    }
    const TileOrder& order = tile.order();
    rays_ += tile.rays();
    rays_suspended_ += tile.rays_suspended();
    on_tile_({order.setup, order.tile, order.lease, tile.rays(), tile.rays_suspended()}, tile.Pixels());
    tiles.spare.push_back(std::move(tiles.open[i]));
    tiles.open.erase(tiles.open.begin() + static_cast<std::ptrdiff_t>(i));
  }
}

void Engine::Run(Mailbox& mailbox) {
  PinSet pins(cache_);
  Tiles tiles;
  const auto any_ready = [&] {
    for (const auto& tile : tiles.open)
      if (tile->has_ready()) return true;
    return false;
  };
  for (int batch = 0; !stop_; ++batch) {
    FinishTiles(tiles);
    bool ready = any_ready();
    if (!ready && tiles.open.size() < kOpenTiles) ready = OpenTile(tiles);
    // Never hold pins while waiting: another thread's block may need the room.
    if (!ready || batch % kBatchesPerPinSet == 0) pins.Release();
    for (uint32_t block : mailbox.Take(!ready)) {
      pins.Adopt(block);
      for (auto& tile : tiles.open) tile->Resume(block);
    }
    for (auto& tile : tiles.open)
      tile->Step(pins, [&](uint32_t block, uint32_t rays) { cache_.Want(block, &mailbox, rays); });
  }
}

}  // namespace quarry

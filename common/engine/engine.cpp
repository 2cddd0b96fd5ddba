#include "common/engine/engine.h"

#include <chrono>
#include <utility>

#include "common/base/resource.h"

namespace quarry {
namespace {

constexpr int kBatchesPerPin = 8;  // pins are let go after so many batches, used up or not

}  // namespace

Engine::Engine(const Catalog& catalog, VoxelCache& cache, unsigned threads, OnTile on_tile)
    : catalog_(catalog), cache_(cache), on_tile_(std::move(on_tile)), window_(threads) {
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
  frames_[setup.setup] = std::make_shared<const FrameContext>(setup.setup, setup.job, catalog_);
  std::erase_if(frames_, [&](const auto& frame) { return frame.first < setup.oldest; });
  std::erase_if(queue_, [&](const TileOrder& order) { return order.setup < setup.oldest; });
}

void Engine::AddTile(const TileOrder& order) {
  {
    const std::lock_guard lock(mutex_);
    if (!frames_.contains(order.setup)) return;
    queue_.push_back(order);
  }
  for (auto& mailbox : mailboxes_) mailbox->Wake();
}

void Engine::DropFrames() {
  const std::lock_guard lock(mutex_);
  frames_.clear();
  queue_.clear();
}

bool Engine::MayOpen(const Tiles& tiles) const {
  if (tiles.open.empty()) return true;
  if (tiles.open.size() >= kMostOpenTiles && !cache_.scarce()) return false;
  return tiles.open.back().renderer->memory_bytes() * (tiles.open.size() + 1) <= TileBytes();
}

bool Engine::OpenTile(Tiles& tiles) {
  std::shared_ptr<const FrameContext> frame;
  TileOrder order;
  {
    const std::lock_guard lock(mutex_);
    if (queue_.empty()) {
      if (!tiles.open.empty()) window_.Starved(cache_.scarce());
      return false;
    }
    order = std::move(queue_.front());
    queue_.pop_front();
    frame = frames_.at(order.setup);
  }
  if (tiles.spare.empty()) tiles.spare.push_back(std::make_unique<TileRenderer>());
  tiles.open.push_back({std::move(tiles.spare.back())});
  tiles.spare.pop_back();
  tiles.open.back().renderer->Open(std::move(frame), order);
  return true;
}

void Engine::FinishTiles(Tiles& tiles) {
  for (size_t i = 0; i < tiles.open.size();) {
    TileRenderer& tile = *tiles.open[i].renderer;
    if (!tile.done()) {
      ++i;
      continue;
    }
    const TileOrder& order = tile.order();
    rays_ += tile.rays();
    rays_suspended_ += tile.rays_suspended();
    TileDone done{order.setup, order.tile, order.lease, tile.rays(), tile.rays_suspended()};
    done.compute_us = tiles.open[i].compute_us;
    done.depths = tile.depths();
    done.blocks = tile.TakeTouched();
    {
      const std::lock_guard lock(mutex_);
      window_.Finished();
    }
    on_tile_(done, tile.Pixels());
    tiles.spare.push_back(std::move(tiles.open[i].renderer));
    tiles.open.erase(tiles.open.begin() + static_cast<std::ptrdiff_t>(i));
  }
}

/// With `wait`, sleeps until there is something to do; `stalled` says that this is for want of blocks.
std::vector<uint32_t> Engine::TakeBlocks(Mailbox& mailbox, bool wait, bool stalled) {
  const auto start = std::chrono::steady_clock::now();
  auto blocks = mailbox.Take(wait);
  if (wait && stalled) stall_us_ += MicrosecondsSince(start);
  return blocks;
}

void Engine::Run(Mailbox& mailbox) {
  PinnedBlocks pins(cache_);
  Tiles tiles;
  const auto any_ready = [&] {
    for (const auto& tile : tiles.open)
      if (tile.renderer->has_ready()) return true;
    return false;
  };
  for (int batch = 0; !stop_; ++batch) {
    FinishTiles(tiles);
    bool ready = any_ready();
    if (!ready && MayOpen(tiles)) ready = OpenTile(tiles);
    // Never hold pins while waiting: another thread's block may need the room.
    if (!ready || batch % kBatchesPerPin == 0) pins.Release();
    for (uint32_t block : TakeBlocks(mailbox, !ready, !tiles.open.empty())) {
      pins.Adopt(block);
      for (auto& tile : tiles.open) tile.renderer->Resume(block);
    }
    const uint64_t start_us = ThreadTimeUs();
    for (auto& tile : tiles.open) {
      if (!tile.renderer->has_ready()) continue;
      const auto start = std::chrono::steady_clock::now();
      tile.renderer->Step(pins, [&](uint32_t block, const TileRenderer::Parked& parked) {
        cache_.Want(block, &mailbox, parked.rays, parked.octants);
      });
      // What a tile costs is time as it passes: a processor that is shared, or held to a part, is a slower
      // one.
      tile.compute_us += MicrosecondsSince(start);
    }
    compute_us_ += ThreadTimeUs() - start_us;
  }
}

}  // namespace quarry

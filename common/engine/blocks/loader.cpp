#include "common/engine/blocks/loader.h"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "common/base/resource.h"
#include "common/voxel/texture_page.h"

namespace quarry {

Status DecodeBlock(const Catalog& catalog, BlockKey block, std::span<const std::byte> stored,
                   BlockDecoder& decoder, ResidentBlock& resident, std::vector<KdNode>* tree) {
  const std::span<std::byte> out = resident.bytes.bytes();
  switch (block.kind()) {
    case BlockKind::kHot: {
      QUARRY_ASSIGN(resident.hot, DecodeHot(decoder, catalog, block.index(), stored, out, tree));
      return {};
    }
    case BlockKind::kShading: {
      QUARRY_ASSIGN(resident.shading, DecodeShading(decoder, catalog, block.index(), stored, out));
      return {};
    }
    case BlockKind::kSky:  // a page in the catalog that it belongs to
      break;
    case BlockKind::kPage: {
      const uint32_t texture = catalog.TextureOf(block);
      return DecodePage(catalog.shapes[texture], catalog.textures[texture].layout, catalog.PageOf(block),
                        stored, out);
    }
  }
  return {};
}

Loader::Loader(VoxelCache& cache, VoxelSource& source, std::function<void(const Error&)> on_error)
    : cache_(cache), source_(source), on_error_(std::move(on_error)) {}

void Loader::Run() {
  // A source that already has the block answers inside Fetch(), which calls Run() again: the loop handles the
  // answer.
  again_ = true;
  if (std::exchange(running_, true)) return;
  const Status ran = WithinLimits([&]() -> Status {
    while (std::exchange(again_, false) && !failed_) {
      InstallArrived();
      AskForMore();
    }
    return {};
  });
  running_ = false;
  if (!ran) Fail(ran.error());
}

void Loader::InstallArrived() {
  while (!failed_ && !arrived_.empty()) {
    const VoxelCache::Turn turn = cache_.NextToPublish();
    const auto next =
        turn.any ? arrived_.begin()
                 : std::ranges::find_if(arrived_, [&](const Arrived& a) { return a.block == turn.block; });
    if (next == arrived_.end() || !Install(*next)) return;
    stored_bytes_ -= next->stored.size();
    --in_flight_;
    arrived_.erase(next);
  }
}

void Loader::AskForMore() {
  while (!failed_) {
    // The block whose turn it is may exceed the bounds, since the arrived blocks wait for it.
    const bool full = in_flight_ >= kMaxInFlight || stored_bytes_ >= kMaxStoredBytes;
    const auto block = full ? cache_.TurnToLoad() : cache_.NextToLoad();
    if (!block) return;
    ++in_flight_;
    stored_bytes_ += cache_.slots().EntryOf(*block).stored;
    VoxelSource& source = block->kind() == BlockKind::kSky ? *environments_[block->sky()] : source_;
    source.Fetch(BlockSlots::KeyInCatalog(*block),
                 [this, id = *block](Result<Bytes> stored) { OnFetched(id, std::move(stored)); });
  }
}

void Loader::OnFetched(BlockKey block, Result<Bytes> stored) {
  if (failed_) return;
  if (!stored) return Fail(stored.error());
  arrived_.push_back({block, std::move(*stored)});
  Run();
}

bool Loader::Install(const Arrived& arrived) {
  const Catalog& catalog = cache_.slots().CatalogOf(arrived.block);
  const BlockKey key = BlockSlots::KeyInCatalog(arrived.block);
  const BlockEntry& entry = catalog.block(key);
  if (!cache_.Reserve(arrived.block)) return false;
  auto resident = std::make_unique<ResidentBlock>();
  const auto start = std::chrono::steady_clock::now();
  auto pages = cache_.TakePages(entry.decoded, key.is_page());
  if (!pages) {
    Fail(Error{fmt::format("the system has no memory for a block of {} bytes; give a smaller --cache",
                           entry.decoded),
               ErrorKind::kMemory});
    return false;
  }
  resident->bytes = std::move(*pages);
  const Status status = DecodeBlock(catalog, key, arrived.stored, decoder_, *resident);
  decode_us_ += MicrosecondsSince(start);
  if (!status) {
    // Its checksum was right: another attempt gives the same.
    Fail(Error{
        fmt::format("block {} at byte {}: {}", catalog.NumberOf(key), entry.offset, status.error().message),
        ErrorKind::kPermanent});
    return false;
  }
  cache_.Publish(arrived.block, std::move(resident));
  return true;
}

void Loader::Fail(const Error& error) {
  if (std::exchange(failed_, true)) return;
  on_error_(error);
}

}  // namespace quarry

#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <vector>

#include "common/engine/blocks/voxel_cache.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/block_decoder.h"

namespace quarry {

/// Decodes `stored` into `resident` and checks it against the catalog. `tree`: see BlockDecoder.
/// Requires: `resident.bytes` has the decoded size. Errors: as DecodeHot(), DecodeShading() and
/// DecodePage().
Status DecodeBlock(const Catalog& catalog, BlockKey block, std::span<const std::byte> stored,
                   BlockDecoder& decoder, ResidentBlock& resident, std::vector<KdNode>* tree = nullptr);

/// Loads the blocks that the cache wants: requests them from the source, decodes and checks them, and
/// publishes them in the cache. Used from one thread, the loader's.
/// Memory: at most kMaxInFlight blocks, and at most kMaxStoredBytes of stored bytes plus a block, are on the
/// way or wait for room; one block more when it must be published before all of these (see
/// VoxelCache::NextToPublish()).
class Loader {
 public:
  /// Limits of blocks, and of their stored bytes, on the way or waiting for room. Trade the latency of a
  /// source that is hidden against memory beyond --cache. A judgement: 16 blocks fill a link of 1 Gbit/s at a
  /// latency of 10 ms.
  static constexpr uint32_t kMaxInFlight = 16;
  static constexpr uint64_t kMaxStoredBytes = 2u << 20;

  /// `on_error` is called once, when a block cannot be had; no block is loaded after it.
  /// Requires: the references outlive the loader.
  Loader(VoxelCache& cache, VoxelSource& source, std::function<void(const Error&)> on_error);

  /// Pages of the environment `number` of the cache come from `source`, which outlives the loader. Before the
  /// first view that names it.
  void SetEnvironment(uint32_t number, VoxelSource& source) { environments_[number] = &source; }
  /// Whether no block that a ray waits for is on its way.
  bool idle() const { return in_flight_ == 0; }
  /// Microseconds of wall time spent decoding, getting memory included.
  uint64_t decode_us() const { return decode_us_; }

  /// Publishes the arrived blocks that have room and requests more within the bounds. Call on the loader's
  /// thread when the cache calls on_want or on_space.
  void Run();

 private:
  struct Arrived {
    BlockKey block;
    Bytes stored;
  };
  /// Publishes the arrived blocks whose turn it is while the cache has room.
  void InstallArrived();
  void AskForMore();
  void OnFetched(BlockKey block, Result<Bytes> stored);
  bool Install(const Arrived& arrived);
  void Fail(const Error& error);

  VoxelCache& cache_;
  VoxelSource& source_;
  std::array<VoxelSource*, BlockSlots::kMostEnvironments> environments_{};
  std::function<void(const Error&)> on_error_;
  BlockDecoder decoder_;
  std::deque<Arrived> arrived_;
  uint32_t in_flight_ = 0;
  uint64_t stored_bytes_ = 0, decode_us_ = 0;
  bool failed_ = false;
  bool running_ = false, again_ = false;
};

}  // namespace quarry

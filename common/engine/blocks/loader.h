#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <span>
#include <vector>

#include "common/engine/blocks/voxel_cache.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/block_decoder.h"

namespace quarry {

/// Decodes `stored` into `resident`, whose bytes have the decoded size, and checks it against the catalog.
/// `tree`: see BlockDecoder.
Status DecodeBlock(const Catalog& catalog, BlockKey block, std::span<const std::byte> stored,
                   BlockDecoder& decoder, ResidentBlock& resident, std::vector<KdNode>* tree = nullptr);

/// Loads the blocks that the cache wants: asks the source (whose bytes are verified), decompresses,
/// publishes. All on one thread. Bounded: at most kMaxInFlight requests and about kMaxStoredBytes of stored
/// bytes are on the way or waiting for room, and one block more where it has to go before all of those (see
/// VoxelCache::NextToPublish).
class Loader {
 public:
  static constexpr uint32_t kMaxInFlight = 16;
  static constexpr uint64_t kMaxStoredBytes = 2u << 20;

  /// `on_error` is called once, when a block cannot be had: rendering cannot go on.
  Loader(const Catalog& catalog, VoxelCache& cache, VoxelSource& source,
         std::function<void(const Error&)> on_error);

  /// True while nothing that a ray waits for is on its way.
  bool idle() const { return in_flight_ == 0; }
  /// Microseconds spent decoding, memory for it included, as time passes: of a processor that is shared too.
  uint64_t decode_us() const { return decode_us_; }

  /// Asks for more while the bounds allow, and installs what waits for room. Call on the loader's thread when
  /// the cache calls on_want or on_space.
  void Run();

 private:
  struct Arrived {
    BlockKey block;
    Bytes stored;
  };
  /// Those whose turn it is, as long as the cache has room.
  void InstallArrived();
  void AskForMore();
  void OnFetched(BlockKey block, Result<Bytes> stored);
  bool Install(const Arrived& arrived);
  void Fail(const Error& error);

  const Catalog& catalog_;
  VoxelCache& cache_;
  VoxelSource& source_;
  std::function<void(const Error&)> on_error_;
  BlockDecoder decoder_;
  std::deque<Arrived> arrived_;
  uint32_t in_flight_ = 0;
  uint64_t stored_bytes_ = 0, decode_us_ = 0;
  bool failed_ = false;
  bool running_ = false, again_ = false;
};

}  // namespace quarry

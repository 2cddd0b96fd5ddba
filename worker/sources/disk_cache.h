#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/catalog.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// Where blocks are kept between runs, and how many bytes of them over all scenes.
struct DiskCacheLocation {
  std::string folder;
  uint64_t bytes = 0;
};
/// "DIR:BYTES", "/var/cache/quarry:20G". Errors (usage): no folder, no size, a size of 0.
Result<DiskCacheLocation> ParseDiskCache(const std::string& text, const std::string& what);

/// Blocks from a folder on a disk of this machine, or from another source, and then into the folder: see
/// CacheFolder. Several processes may share one. What the folder holds is believed only if it has the
/// catalog's size and checksum; what is damaged is removed and fetched again.
///
/// Nothing that goes wrong with the disk is an error of Fetch. A folder that cannot be read is as if it were
/// empty; one that cannot be written (full, read-only) is not written for a minute, then tried again. Either
/// is told once. Disk is read and written on a thread of its own, reads first; writes wait in a queue of
/// at most 4 MiB (beside one block of any size), and what does not fit there is not kept.
class DiskCachedSource final : public VoxelSource {
 public:
  struct Counters {
    uint64_t hits = 0, misses = 0;  ///< blocks; a damaged one is a miss
    uint64_t bytes_read = 0, bytes_written = 0;
    uint64_t damaged = 0;      ///< blocks found with another size or checksum
    uint64_t not_written = 0;  ///< blocks fetched and not kept: disk behind or failing
    uint64_t evicted = 0;      ///< blocks removed for want of room
  };
  using Log = std::function<void(const std::string&)>;

  /// `inner` and `catalog` must outlive the source. `log` is given a sentence on the io_context's thread.
  DiskCachedSource(boost::asio::io_context& io, VoxelSource& inner, const DiskCacheLocation& location,
                   const Catalog& catalog, Log log);
  /// The same with an inner source of its own.
  DiskCachedSource(boost::asio::io_context& io, std::unique_ptr<VoxelSource> inner,
                   const DiskCacheLocation& location, const Catalog& catalog, Log log);
  /// Closes it.
  ~DiskCachedSource() override;
  /// Requires: not closed.
  void Fetch(BlockKey block, Done done) override;

  /// Writes what is queued, then ends its thread: the counters are final. `done`s outstanding are never
  /// called. Once closed, nothing happens.
  void Close();

  /// From any thread.
  Counters counters() const;

 private:
  struct Impl;
  std::unique_ptr<VoxelSource> owned_;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

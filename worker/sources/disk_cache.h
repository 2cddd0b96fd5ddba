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

/// The folder of a disk cache and the limit of its bytes over all scenes.
struct DiskCacheLocation {
  std::string folder;
  uint64_t bytes = 0;
};
/// Parses "DIR:BYTES", such as "/var/cache/quarry:20G". Errors (usage; the message names `what`): no folder,
/// no size, a size of 0.
Result<DiskCacheLocation> ParseDiskCache(const std::string& text, const std::string& what);

/// Blocks from a folder on a local disk (CacheFolder) in front of another source. Blocks that the folder
/// lacks are fetched from the other source and then written to the folder. Several processes may share a
/// folder. A file is used only if it has the catalog's size and checksum; a damaged file is removed and the
/// block fetched.
/// Errors: problems of the disk never fail a Fetch(). An unreadable folder counts as empty. After a failed
/// write (disk full, read-only) nothing is written for a minute. Each of the two is logged once.
/// Disk access runs on a thread of its own, reads first. Blocks to be written wait in a queue of 4 MiB, or
/// one block of any size; a block that does not fit is not kept.
class DiskCachedSource final : public VoxelSource {
 public:
  struct Counters {
    uint64_t hits = 0, misses = 0;  ///< blocks; a damaged block is a miss
    uint64_t bytes_read = 0, bytes_written = 0;
    uint64_t damaged = 0;      ///< blocks with another size or checksum
    uint64_t not_written = 0;  ///< blocks fetched but not kept: the disk is slow or fails
    uint64_t evicted = 0;      ///< blocks removed to make room
  };
  using Log = std::function<void(const std::string&)>;

  /// `inner` and `catalog` must outlive the source. `log` gets sentences on the io_context's thread.
  DiskCachedSource(boost::asio::io_context& io, VoxelSource& inner, const DiskCacheLocation& location,
                   const Catalog& catalog, Log log);
  /// As above, but owns the inner source.
  DiskCachedSource(boost::asio::io_context& io, std::unique_ptr<VoxelSource> inner,
                   const DiskCacheLocation& location, const Catalog& catalog, Log log);
  /// Calls Close().
  ~DiskCachedSource() override;
  /// Requires: Close() was not called.
  void Fetch(BlockKey block, Done done) override;

  /// Writes the queued blocks, then ends the thread; the counters are final afterwards. Outstanding `done`s
  /// are never called. Further calls do nothing.
  void Close();

  /// Thread-safe.
  Counters counters() const;

 private:
  struct Impl;
  std::unique_ptr<VoxelSource> owned_;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

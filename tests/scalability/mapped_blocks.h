#pragma once

#include <cstddef>
#include <memory>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "common/base/status.h"
#include "common/engine/blocks/voxel_cache.h"
#include "common/voxel/store_reader.h"
#include "tests/scalability/line.h"

namespace quarry::bench {

/// A store's decoded blocks in memory that behaves like a file mapped over a network (userfaultfd). No page
/// is resident at first. A thread that touches a page waits until the chunk around the page has come along a
/// line. Chunks stay resident.
class MappedBlocks {
 public:
  static constexpr size_t kChunk = 128u << 10;  ///< bytes read at once, as by NFS

  /// The reason why this system does not forward page faults; empty when it does.
  static std::string WhyNot();
  /// Memory: twice the decoded size. Errors: a damaged store; a system that does not forward page faults.
  static Result<std::unique_ptr<MappedBlocks>> Make(const StoreReader& store, Line& line);
  ~MappedBlocks();

  /// Takes the blocks, by block number; null for a block that the store lacks. Their bytes belong to this
  /// object. Call once.
  std::vector<std::unique_ptr<ResidentBlock>> TakeBlocks() { return std::move(blocks_); }

 private:
  explicit MappedBlocks(Line& line) : line_(line) {}
  Status Decode(const StoreReader& store);
  Status HandFaultsOn();
  void Serve();

  Line& line_;
  std::span<std::byte> region_, file_;  ///< the memory that is touched; the memory that chunks are read from
  std::vector<std::unique_ptr<ResidentBlock>> blocks_;
  int faults_ = -1, stop_ = -1;  ///< file descriptors
  std::thread server_;
};

}  // namespace quarry::bench

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

/// A store's decoded blocks as if they lay in a file that is mapped over the network: nothing is in memory at
/// first; who touches a page waits until the chunk around it has come along a line (userfaultfd). What has
/// come stays.
class MappedBlocks {
 public:
  static constexpr size_t kChunk = 128u << 10;  ///< read at once, as by NFS

  /// Why this system does not hand page faults on; empty if it does.
  static std::string WhyNot();
  /// Needs twice the decoded size of memory. Errors: a damaged store; a system that does not hand page faults
  /// on.
  static Result<std::unique_ptr<MappedBlocks>> Make(const StoreReader& store, Line& line);
  ~MappedBlocks();

  /// By block id, null for those that the store lacks; their bytes are this object's. Once.
  std::vector<std::unique_ptr<ResidentBlock>> TakeBlocks() { return std::move(blocks_); }

 private:
  explicit MappedBlocks(Line& line) : line_(line) {}
  Status Decode(const StoreReader& store);
  Status HandFaultsOn();
  void Serve();

  Line& line_;
  std::span<std::byte> region_, file_;  ///< what is touched; what it is read from
  std::vector<std::unique_ptr<ResidentBlock>> blocks_;
  int faults_ = -1, stop_ = -1;  ///< descriptors
  std::thread server_;
};

}  // namespace quarry::bench

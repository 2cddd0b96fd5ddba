#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "common/base/status.h"
#include "common/voxel/block_decoder.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// The steps of StoreReader::Verify(). Voxels come in order. The store outlives the verifier. Not
/// thread-safe. Errors of all members: the first problem found.
class StoreVerifier {
 public:
  explicit StoreVerifier(const StoreReader& store);

  Status CheckPartTree() const;
  /// Reads and decodes the voxel's blocks, and compares the directory and its parts with them.
  Status CheckVoxel(uint32_t voxel);
  /// Checks that nothing follows the last voxel.
  Status CheckVoxelsEnd() const;
  Status CheckTexture(uint32_t texture) const;
  /// Checks that the pages fill their section without gaps. Pages lie in the order in which they were
  /// completed.
  Status CheckPagesFill() const;

 private:
  Status CheckHot(uint32_t voxel, std::span<const std::byte> stored);

  const StoreReader& store_;
  BlockDecoder decoder_;
  std::optional<PartListReader> lists_;
  uint64_t blocks_end_;  ///< of the voxels so far
};

}  // namespace quarry

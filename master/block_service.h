#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>

#include "common/net/connection.h"
#include "common/net/voxel_source.h"
#include "common/protocol/messages.h"

namespace quarry {

/// Answers requests for blocks, of any number of connections, from one source; at most kMostBlockRequests of
/// a connection at a time. Used from the source's thread.
class BlockService {
 public:
  explicit BlockService(VoxelSource& source) : source_(source) {}

  /// Errors: it is no request; the connection has asked for too much at once.
  Status Answer(const std::shared_ptr<Connection>& c, const Message& request);
  uint64_t bytes_served() const { return bytes_served_; }

 private:
  VoxelSource& source_;
  std::unordered_map<const Connection*, uint32_t> owed_;  ///< answers; they keep their connection alive
  uint64_t bytes_served_ = 0;
};

}  // namespace quarry

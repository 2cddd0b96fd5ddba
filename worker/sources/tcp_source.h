#pragma once

#include <memory>

#include "common/engine/blocks/voxel_source.h"
#include "common/net/connection.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Blocks from a Quarry voxel server: a master (also with --serve-only) or another worker. It uses one
/// connection, opened by the first request and reopened by the first request after a loss. Requests are
/// pipelined, at most kMostBlockRequests at once; further requests wait.
/// Errors: a failure of the server or the network fails all waiting requests at once; the caller decides
/// about retries. A server that owes an answer and sends no byte for kStallS counts as lost. A ping at the
/// same interval shows the server that this side is alive.
/// Used from the io_context's thread.
class TcpVoxelSource final : public VoxelSource {
 public:
  /// Seconds.
  static constexpr double kStallS = 5;
  /// A server that sends a block larger than the scene's largest is dropped. Requires: `catalog` outlives the
  /// source.
  TcpVoxelSource(boost::asio::io_context& io, Endpoint server, Security security, const Catalog& catalog);
  ~TcpVoxelSource() override;
  void Fetch(BlockKey block, Done done) override;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

#pragma once

#include <memory>

#include "common/engine/blocks/voxel_source.h"
#include "common/net/connection.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Blocks from a Quarry voxel server: a master, one with --serve-only, or another worker. One connection,
/// made with the first request and made again with the first after a loss; requests are pipelined,
/// kMostBlockRequests at most; more wait for answers to those. Whatever is wrong with the server or the way
/// to it fails all that wait, at once: whoever asks decides what next. A server that sends not a byte for
/// kStallS seconds while it owes an answer is taken for lost; it hears a Ping as often, so that it does not
/// take this side for one that is idle.
class TcpVoxelSource final : public VoxelSource {
 public:
  static constexpr double kStallS = 5;
  /// `most_block_bytes`: of a stored block; a server that sends a larger one is lost.
  TcpVoxelSource(boost::asio::io_context& io, Endpoint server, Security security, SceneId scene,
                 uint32_t most_block_bytes);
  ~TcpVoxelSource() override;
  void Fetch(BlockKey block, Done done) override;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

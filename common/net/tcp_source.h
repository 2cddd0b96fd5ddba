#pragma once

#include <memory>
#include <string>
#include <unordered_map>

#include "common/net/connection.h"
#include "common/net/voxel_source.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Blocks from a Quarry voxel server (a master, or one with --serve-only), over a connection of their own.
/// When the connection is lost it is made again, every second for as long as `give_up_after_s`, and what was
/// asked for is asked for once more.
class TcpVoxelSource final : public VoxelSource {
 public:
  TcpVoxelSource(boost::asio::io_context& io, Endpoint server, Security security, SceneId scene,
                 double give_up_after_s);
  ~TcpVoxelSource() override;
  void Fetch(uint32_t block, Done done) override;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

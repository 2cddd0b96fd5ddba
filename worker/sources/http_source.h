#pragma once

#include <cstdint>
#include <memory>

#include "common/engine/blocks/voxel_source.h"
#include "common/remote/http_client.h"
#include "common/remote/http_options.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Blocks of a store on any HTTP server with range requests (nginx, an S3-compatible store), at the offsets
/// of the catalog. Before the first block it fetches the store's header and section table, and refuses
/// another scene or another compression of the scene. It does not check the blocks themselves. Used from the
/// io_context's thread.
/// Errors of Fetch(): as HttpRangeClient::Get(); no such block (permanent); the file is not the scene's store
/// (permanent); its size has changed (permanent). After a failed check the next Fetch() checks again.
class HttpVoxelSource final : public VoxelSource {
 public:
  struct Counters {
    uint64_t bytes_received = 0;  ///< bytes of blocks
    HttpRangeClient::Counters http;
  };

  /// Requires: `catalog` outlives the source.
  HttpVoxelSource(boost::asio::io_context& io, HttpLocation location, const Catalog& catalog,
                  HttpOptions options);
  ~HttpVoxelSource() override;
  void Fetch(BlockKey block, Done done) override;

  Counters counters() const;

 private:
  struct Impl;
  std::shared_ptr<Impl> impl_;
};

}  // namespace quarry

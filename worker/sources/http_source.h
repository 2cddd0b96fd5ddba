#pragma once

#include <cstdint>
#include <memory>

#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/catalog.h"
#include "worker/sources/http_client.h"
#include "worker/sources/http_options.h"

namespace quarry {

/// Blocks of a store that lies on any HTTP server with range requests (nginx, an S3-compatible store), by the
/// offsets of the catalog. Before the first block the store's header and section table are fetched: a server
/// with another scene, or with the same one compressed in another way, is refused. What is fetched is not
/// checked beyond that.
///
/// Errors of Fetch, beside those of HttpRangeClient: no such block; the file is not the scene's store
/// (permanent); it has another size than it had (permanent). After an error of the check the next Fetch
/// checks again.
class HttpVoxelSource final : public VoxelSource {
 public:
  struct Counters {
    uint64_t bytes_received = 0;  ///< of blocks
    HttpRangeClient::Counters http;
  };

  /// `catalog` must outlive the source.
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

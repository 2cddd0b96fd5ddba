#pragma once

#include <cstdint>
#include <future>
#include <span>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/store_writer.h"

namespace quarry {

/// Encodes the pages of the writer's last texture on `threads` threads and writes them in the order of Add().
/// Memory: two batches of pages. Thread safety: one caller.
class PagePipeline {
 public:
  PagePipeline(StoreWriter& writer, unsigned threads) : writer_(writer), threads_(threads) {}
  ~PagePipeline();
  PagePipeline(const PagePipeline&) = delete;

  /// Errors: those of an earlier page; disk full.
  Status Add(uint32_t page, std::span<const std::byte> texels);
  /// Waits until all pages are written. Errors: as Add().
  Status Finish();

 private:
  struct Task {
    uint32_t page = 0;
    Bytes texels;
    EncodedPage encoded;
  };
  Status HandOver();
  Status EncodeBatch();

  StoreWriter& writer_;
  unsigned threads_;
  std::vector<Task> gathered_, batch_;  ///< a second thread owns the batch while it runs
  std::future<Status> under_way_;
};

}  // namespace quarry

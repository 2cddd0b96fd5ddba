#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "common/voxel/store_writer.h"

namespace quarry {

/// Encodes the pages of textures on `threads` threads and writes them in the order of Add(). One texture's
/// pages are encoded while the next one's are made. With one thread, Add() encodes. Memory: 128 pages. Thread
/// safety: one caller, whose thread also writes.
class PagePipeline {
 public:
  PagePipeline(StoreWriter& writer, unsigned threads);
  ~PagePipeline();

  /// Begins a texture, whose pages follow. Errors, here and below: disk full; an error of a
  /// step of Then().
  void Begin(const TexelLayout& layout);
  Status Add(uint32_t page, std::span<const std::byte> texels);
  /// Calls `step` once all pages added before it are written, before any page added after it is.
  Status Then(std::function<Status()> step);
  /// Waits until all is written.
  Status Finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry

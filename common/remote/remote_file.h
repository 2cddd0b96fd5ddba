#pragma once

#include <memory>

#include "common/base/file.h"
#include "common/remote/http_client.h"
#include "common/remote/http_options.h"

namespace quarry {

/// A store on an HTTP server with range requests, read by requests of its own, HttpOptions::connections at
/// once. The first 64 KiB, where a store's header and section table lie, are read once and kept. A request
/// that fails for now is repeated for 10 s.
class RemoteFile final : public RandomAccessFile {
 public:
  /// Errors: as HttpRangeClient::Get(); the server does not state the file's size.
  static Result<std::unique_ptr<RandomAccessFile>> Open(const HttpLocation& location,
                                                        const HttpOptions& options);
  ~RemoteFile() override;

  const std::string& path() const override;
  uint64_t size() const override;
  /// Errors: as HttpRangeClient::Get(); the file there has another size than when it was opened.
  Status ReadAt(uint64_t offset, std::span<std::byte> out) const override;

 private:
  struct Impl;
  explicit RemoteFile(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace quarry

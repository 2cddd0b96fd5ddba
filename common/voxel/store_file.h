#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "common/base/status.h"

namespace quarry {

/// The bytes of a store, wherever they lie. Thread-safe.
class StoreFile {
 public:
  virtual ~StoreFile() = default;
  /// Its name in messages: a path or an address, without secrets.
  virtual const std::string& path() const = 0;
  /// Bytes in the file when it was opened.
  virtual uint64_t size() const = 0;
  /// Fills `out` from `offset`. Errors: they cannot be read; the file ends before `out` is full.
  virtual Status ReadAt(uint64_t offset, std::span<std::byte> out) const = 0;
};

}  // namespace quarry

#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/status.h"

namespace quarry {

/// The name at an offset of STRS.
using NameLookup = std::function<Result<std::string>(uint32_t offset)>;

/// Longest name that a reader gives, in bytes; longer names are cut. Foreign stores may let many entries name
/// one long string.
inline constexpr size_t kMostNameBytes = 4096;
/// Limit of the names of all cameras and lights, which stay in memory, in bytes.
inline constexpr size_t kMostViewNameBytes = 4 << 20;

/// The names of a store, read from its sections PART and STRS when asked for: a model may have millions. A
/// window of each section stays in memory, so that names asked for in order are read in large pieces.
/// Thread-safe.
class StoreNames {
 public:
  /// Bytes of a section that stay in memory.
  static constexpr uint64_t kWindowBytes = 256 << 10;
  /// Where a section lies in the file.
  struct Place {
    uint64_t offset = 0, size = 0;
  };

  /// `file` must outlive this.
  StoreNames(const RandomAccessFile& file, Place parts, Place strings)
      : file_(file), parts_{parts, {}, 0}, strings_{strings, {}, 0} {}

  /// Bytes of all names.
  uint64_t bytes() const { return strings_.place.size; }
  uint64_t part_count() const { return parts_.place.size / sizeof(uint32_t); }
  /// The name of a part; empty when there is no such part. Errors: the file cannot be read.
  Result<std::string> Part(uint32_t part) const;
  /// The zero-terminated string at `offset` of STRS, its first kMostNameBytes; empty when `offset` is beyond
  /// the end. Errors: the file cannot be read.
  Result<std::string> At(uint32_t offset) const;

 private:
  struct Window {
    Place place;
    Bytes bytes;
    uint64_t begin = 0;  ///< within the section
  };
  /// The bytes of the section from `at` on that the window has; at least one. Requires: at < place.size.
  Result<std::span<const std::byte>> From(Window& window, uint64_t at) const;
  Result<std::string> Text(uint32_t offset) const;

  const RandomAccessFile& file_;
  mutable std::mutex mutex_;
  mutable Window parts_, strings_;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <vector>

#include "common/base/status.h"
#include "tests/laboratory/memory.h"

namespace quarry::laboratory {

/// The shape of a simulated cache. The default is that of Purcell et al. 2002, section 4.1.
struct TextureCacheOptions {
  uint64_t bytes = 64 * 1024;  ///< size; the rest behind the last whole set is not used
  uint32_t line = 48;          ///< bytes of a line, any number from 4
  uint32_t ways = 1;           ///< lines of a set; 1: direct mapped
};

/// The accesses to a cache. Lines are counted apart: an access that spans two lines is one access and two
/// lines.
struct CacheTotals {
  uint64_t accesses = 0;
  uint64_t hits = 0;    ///< lines that were there
  uint64_t misses = 0;  ///< lines that were fetched from memory

  bool operator==(const CacheTotals&) const = default;
};

/// A simulated read-only cache: it holds the numbers of lines and no data. A line is address / line, and it
/// belongs to set (line number) mod sets; within a set the line that was used longest ago leaves. The number
/// of sets is floor(bytes / (line * ways)). Deterministic. Not thread-safe.
class TextureCache {
 public:
  /// Errors: a line shorter than 4 bytes, no way, less than one set, more than 256 MiB.
  static Result<TextureCache> Create(const TextureCacheOptions& options = {});

  /// Reads bytes [address, address + bytes). An access of 0 bytes is not counted.
  /// Requires: address + bytes does not overflow.
  /// Returns: lines fetched from memory.
  uint32_t Access(uint64_t address, uint32_t bytes);
  /// As above, and counts for `kind` too.
  uint32_t Access(DataKind kind, uint64_t address, uint32_t bytes);

  /// Drops each line that holds one of the bytes [begin, end). Time: the lesser of the range's lines and the
  /// cache's. Requires: begin <= end.
  void Invalidate(uint64_t begin, uint64_t end);
  /// Drops all lines. The totals stay.
  void Clear();

  /// Of all accesses, with and without a kind.
  const CacheTotals& totals() const { return totals_; }
  const CacheTotals& totals(DataKind kind) const { return by_kind_[static_cast<uint32_t>(kind)]; }
  /// Bytes fetched from memory: misses * line.
  uint64_t fetched_bytes() const { return totals_.misses * options_.line; }
  uint64_t fetched_bytes(DataKind kind) const { return totals(kind).misses * options_.line; }

  const TextureCacheOptions& options() const { return options_; }
  uint64_t sets() const { return lines_.size() / options_.ways; }

 private:
  static constexpr uint64_t kNoLine = UINT64_MAX;

  explicit TextureCache(const TextureCacheOptions& options);
  /// Uses a line; true if it was there.
  bool Use(uint64_t line);
  void Drop(uint64_t line);

  TextureCacheOptions options_;
  /// By set: `ways` lines, the last used first, kNoLine behind them.
  std::vector<uint64_t> lines_;
  CacheTotals totals_, by_kind_[kDataKinds];
};

}  // namespace quarry::laboratory

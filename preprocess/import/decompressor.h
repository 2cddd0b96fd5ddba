#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace quarry {

/// Unpacks a stream of bytes piece by piece. Concatenated packed streams count as one. Thread safety: none.
class Decompressor {
 public:
  virtual ~Decompressor() = default;

  struct Step {
    size_t taken = 0, given = 0;  ///< bytes read from `in`, written to `out`
    std::string error;            ///< why the bytes cannot be unpacked; empty: no error
  };
  /// Reads from `in` and writes to `out` as much as possible.
  virtual Step Run(std::span<const char> in, std::span<char> out) = 0;
  /// Whether the bytes so far end where a packed stream ends.
  virtual bool AtEnd() const = 0;
};

/// Sets the memory in bytes that a Zstandard window may take, for decompressors made from now on; 128 MiB
/// (zstd's limit) before the first call. A larger window is an error with advice to unpack the file.
void LimitZstdWindow(uint64_t bytes);

/// A decompressor for bytes that begin with `start`: gzip or Zstandard; null for other bytes.
std::unique_ptr<Decompressor> MakeDecompressor(std::string_view start);

}  // namespace quarry

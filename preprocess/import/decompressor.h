#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <string_view>

namespace quarry {

/// Unpacks a stream of bytes piece by piece. Several packed streams one behind the other are one.
class Decompressor {
 public:
  virtual ~Decompressor() = default;

  struct Step {
    size_t taken = 0, given = 0;  ///< bytes of `in`, of `out`
    std::string error;            ///< what is wrong with the bytes; else empty
  };
  /// Takes from `in`, gives to `out`, as much as there is and fits.
  virtual Step Run(std::span<const char> in, std::span<char> out) = 0;
  /// Whether the bytes so far end where a packed stream does.
  virtual bool AtEnd() const = 0;
};

/// The most memory that a Zstandard window may take, in all that are made from now on: at first 128 MiB,
/// zstd's own limit. Larger windows are errors that say how to unpack the file.
void LimitZstdWindow(uint64_t bytes);

/// What unpacks bytes that begin with `start`: gzip or Zstandard; null for anything else.
std::unique_ptr<Decompressor> MakeDecompressor(std::string_view start);

}  // namespace quarry

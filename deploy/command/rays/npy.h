#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"

// Arrays in NumPy's files (.npy), versions 1 to 3.

namespace quarry {

/// An array of numbers in rows.
struct NpyShape {
  bool float32 = false;  ///< else float64; both little-endian
  uint64_t rows = 0, columns = 0;
};

/// Reads rows of floats from a descriptor, in order. Not thread-safe.
class NpyReader {
 public:
  /// Reads the header. `name`: of the file, for messages. Errors: not such a file; another type, order or
  /// dimension; cut short. The sentence names the byte.
  static Result<NpyReader> Open(int fd, std::string name);

  const NpyShape& shape() const { return shape_; }
  uint64_t rows_left() const { return shape_.rows - next_row_; }
  /// Where a row begins in the file, for messages.
  uint64_t ByteOf(uint64_t row) const { return data_begin_ + row * RowBytes(); }
  /// Appends the next `rows` rows to `out`, as doubles. Requires: rows <= rows_left(). Errors: the file ends
  /// before them (the sentence names the byte); read errors.
  Status Read(uint64_t rows, std::vector<double>& out);
  /// Errors: bytes after the last row. Requires: rows_left() == 0.
  Status CheckEnd();

 private:
  NpyReader(int fd, std::string name) : fd_(fd), name_(std::move(name)) {}
  uint64_t RowBytes() const { return shape_.columns * (shape_.float32 ? 4 : 8); }
  Result<size_t> ReadSome(std::span<std::byte> out);
  Status ReadHeader();

  int fd_;
  std::string name_;
  NpyShape shape_;
  uint64_t data_begin_ = 0, next_row_ = 0;
  Bytes buffer_;
};

/// Parses a header's dictionary. Errors: as NpyReader::Open(), without the file's name.
Result<NpyShape> ParseNpyHeader(std::string_view text);

/// The header of a one-dimensional array: always of 256 bytes, so that it can be written anew with the true
/// number of rows. `descr`: NumPy's text for the type of an entry.
std::string NpyHeader(const std::string& descr, uint64_t rows);

}  // namespace quarry

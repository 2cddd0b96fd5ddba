#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <vector>

#include "preprocess/import/model_reader.h"
#include "preprocess/import/work_team.h"

namespace quarry {

/// The buffered rows of a binary file whose rows have one size, decoded by several threads. Thread safety:
/// none.
class RowChunk {
 public:
  /// The next rows: at most `most`, at most those that the buffer holds once it is filled, and few enough to
  /// stay in the caches until they are used: kRowsOfPart for each thread. `team`: null if there is none.
  /// Requires: row_bytes <= ModelReader::kBufferBytes.
  RowChunk(ModelReader& bytes, size_t row_bytes, uint64_t most, WorkTeam* team)
      : bytes_(bytes), row_bytes_(row_bytes), team_(team) {
    constexpr uint64_t kBuffer = ModelReader::kBufferBytes;
    constexpr size_t kLittle = 64 << 10;  // filling moves the bytes that are left, so it waits for few
    const uint64_t wanted = std::min(kBuffer, std::min(most, kBuffer) * row_bytes);
    if (bytes.available() < std::max(kLittle, row_bytes)) bytes.Ensure(wanted);
    const uint64_t at_once = kRowsOfPart * (team ? team->threads() : 1);
    rows_ = std::min({uint64_t{bytes.available() / row_bytes}, most, at_once});
  }

  size_t rows() const { return rows_; }
  const char* row(size_t i) const { return bytes_.data() + i * row_bytes_; }

  /// Keeps the rows before the first of which `is_wanted(row)` is false.
  template <typename IsWanted>
  void CutBefore(IsWanted&& is_wanted) {
    size_t n = 0;
    while (n < rows_ && is_wanted(row(n))) ++n;
    rows_ = n;
  }

  /// Calls decode(row, i) for all rows, by several threads. Returns the number of rows before the first of
  /// which it returned false.
  template <typename DecodeRow>
  size_t Decode(DecodeRow&& decode) const {
    std::atomic<size_t> good = rows_;
    const auto decode_part = [&](size_t part) {
      const size_t end = std::min(rows_, (part + 1) * kRowsOfPart);
      for (size_t i = part * kRowsOfPart; i < end; ++i) {
        if (decode(row(i), i)) [[likely]]
          continue;
        for (size_t least = good; i < least && !good.compare_exchange_weak(least, i);) {
        }
        return;
      }
    };
    const size_t parts = (rows_ + kRowsOfPart - 1) / kRowsOfPart;
    if (team_)
      team_->ForEach(parts, decode_part);
    else
      for (size_t part = 0; part < parts; ++part) decode_part(part);
    return good;
  }

  /// Ends with the first `rows` rows, which have been used.
  void Consume(size_t rows) { bytes_.Consume(rows * row_bytes_); }

 private:
  static constexpr size_t kRowsOfPart = 2048;

  ModelReader& bytes_;
  size_t row_bytes_, rows_ = 0;
  WorkTeam* team_;
};

}  // namespace quarry

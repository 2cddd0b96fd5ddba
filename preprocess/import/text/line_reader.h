#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "preprocess/import/model_reader.h"

namespace quarry {

/// Reads a text file by lines, on top of a ModelReader that outlives it. Lines end in LF, CR LF or CR; the
/// last may lack its end. A UTF-8 byte order mark at the file's start is passed over.
class LineReader {
 public:
  /// A line, continuations included, is at most this long.
  static constexpr size_t kLongestLine = ModelReader::kBufferBytes;

  explicit LineReader(ModelReader& bytes) : bytes_(bytes) {}

  /// Sets `line` to the next line without its end; valid until the next call. Returns false at the file's
  /// end. Errors: a line over kLongestLine, a read error.
  Result<bool> Next(std::string_view& line);

  /// Like Next(), with lines that end in a backslash, and blanks perhaps, joined to the next by a blank.
  /// Comments ('#') and lines that name a group, an object or a material are not: a folder's name at their
  /// end would swallow a line.
  Result<bool> NextJoined(std::string_view& line);

  /// The number, from 1, of the line read last (the last of joined ones).
  uint64_t line_number() const { return line_number_; }
  /// The next line is the one after that number.
  void GoOnAfterLine(uint64_t number) { line_number_ = number; }

  /// "PATH, line N: " + `what`.
  tl::unexpected<Error> FailHere(const std::string& what) const;

 private:
  /// Sets `line` to what `seen` has before the first end of a line, and passes both. False: it has none.
  bool TakeLine(std::string_view seen, size_t searched, std::string_view& line);
  Result<bool> JoinFollowing(std::string_view& line);
  void SkipByteOrderMark();

  ModelReader& bytes_;
  uint64_t line_number_ = 0;
  char end_ = '\n';  ///< of lines, as it was last: looked for first
  std::string joined_;
};

}  // namespace quarry

#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "preprocess/import/model_reader.h"

namespace quarry {

/// Reads a text file line by line from a ModelReader, which must outlive it. Lines end in LF, CR LF or CR;
/// the last may lack its end. A UTF-8 byte order mark at the start is skipped. Thread safety: none.
class LineReader {
 public:
  /// Bytes of a line, continuations included, at most.
  static constexpr size_t kLongestLine = ModelReader::kBufferBytes;

  explicit LineReader(ModelReader& bytes) : bytes_(bytes) {}

  /// Sets `line` to the next line without its end, valid until the next call. False at the file's end.
  /// Errors: a line over kLongestLine; a read error.
  Result<bool> Next(std::string_view& line);

  /// Like Next(), but a line that ends in a backslash, perhaps followed by blanks, is joined to the next by a
  /// blank. Comments ('#') and lines that name a group, object or material are not joined: a folder's name at
  /// their end would swallow a line.
  Result<bool> NextJoined(std::string_view& line);

  /// The number, from 1, of the last line read (the last of joined lines).
  uint64_t line_number() const { return line_number_; }

  /// "PATH, line N: " + `what`.
  tl::unexpected<Error> FailHere(const std::string& what) const;

 private:
  /// Sets `line` to the text before the first line end in `seen`, and consumes both. False: there is no line
  /// end.
  bool TakeLine(std::string_view seen, size_t searched, std::string_view& line);
  Result<bool> JoinFollowing(std::string_view& line);
  void SkipByteOrderMark();

  ModelReader& bytes_;
  uint64_t line_number_ = 0;
  char end_ = '\n';  ///< the last line's end, looked for first
  std::string joined_;
};

}  // namespace quarry

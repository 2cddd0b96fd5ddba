#pragma once

#include <string>
#include <string_view>

#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {

/// Reads a text file word by word, across lines, without comments ('#' or '%' to the line's end). Thread
/// safety: none.
class WordReader {
 public:
  explicit WordReader(ModelReader& bytes) : lines_(bytes) {}

  /// The next word without consuming it; empty at the file's end. Valid until the next call. Errors:
  /// LineReader's.
  Result<std::string_view> Peek();
  /// Consumes the word that Peek() returned.
  void Skip() { cursor_.Word(); }
  /// Consumes and returns the next word. Errors also: the file ends before the word.
  Result<std::string> Word(const char* what);
  /// Whether the next word is a number.
  Result<bool> AtNumber();
  /// Consumes a number. Errors: the next word is none.
  Result<double> Number(const char* what);
  /// Consumes an index or count. Errors: the next word is none from 0 to `most`.
  Result<uint32_t> Index(const char* what, uint64_t most);

  tl::unexpected<Error> FailHere(const std::string& what) const { return lines_.FailHere(what); }

 private:
  LineReader lines_;
  TextCursor cursor_{std::string_view()};
};

}  // namespace quarry

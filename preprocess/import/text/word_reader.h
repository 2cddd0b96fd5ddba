#pragma once

#include <string>
#include <string_view>

#include "preprocess/import/text/line_reader.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {

/// A text file's words, wherever its lines end, without comments ('#' or '%' to the end of a line).
class WordReader {
 public:
  explicit WordReader(ModelReader& bytes) : lines_(bytes) {}

  /// The next word, which stays the next; empty at the file's end. Valid until the next call. Errors: those
  /// of LineReader.
  Result<std::string_view> Peek();
  /// Passes the word that Peek gave.
  void Skip() { cursor_.Word(); }
  /// The next word, passed. Errors also: the file ends where `what` should be.
  Result<std::string> Word(const char* what);
  /// Whether the next word is a number.
  Result<bool> AtNumber();
  /// The next word as a number. Errors: it is none.
  Result<double> Number(const char* what);
  /// As an index or count. Errors: it is none from 0 to `most`.
  Result<uint32_t> Index(const char* what, uint64_t most);

  tl::unexpected<Error> FailHere(const std::string& what) const { return lines_.FailHere(what); }

 private:
  LineReader lines_;
  TextCursor cursor_{std::string_view()};
};

}  // namespace quarry

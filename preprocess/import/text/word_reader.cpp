#include "preprocess/import/text/word_reader.h"

#include <fmt/format.h>

namespace quarry {

Result<std::string_view> WordReader::Peek() {
  while (cursor_.AtEnd() || *cursor_.next == '%') {
    std::string_view line;
    QUARRY_ASSIGN(const bool more, lines_.Next(line));
    cursor_ = TextCursor(line);
    if (!more) return std::string_view();
  }
  TextCursor word = cursor_;
  return word.Word();
}

Result<std::string> WordReader::Word(const char* what) {
  QUARRY_ASSIGN(const std::string_view word, Peek());
  if (word.empty()) return FailHere(fmt::format("the file ends where {} should be", what));
  std::string taken(word);
  Skip();
  return taken;
}

Result<bool> WordReader::AtNumber() {
  QUARRY_ASSIGN(const std::string_view word, Peek());
  TextCursor cursor(word);
  double ignored;
  return !word.empty() && ParseReal(cursor, ignored);
}

Result<double> WordReader::Number(const char* what) {
  QUARRY_ASSIGN(const std::string_view word, Peek());
  if (word.empty()) return FailHere(fmt::format("the file ends where {} should be", what));
  TextCursor cursor(word);
  double value;
  if (!ParseReal(cursor, value))
    return FailHere(fmt::format("{} should be here, a number, not {}", what, Quoted(word)));
  Skip();
  return value;
}

Result<uint32_t> WordReader::Index(const char* what, uint64_t most) {
  QUARRY_ASSIGN(const std::string_view word, Peek());
  TextCursor cursor(word);
  int64_t value;
  if (word.empty() || !ParseInteger(cursor, value) || cursor.next != cursor.end || value < 0 ||
      static_cast<uint64_t>(value) > most)
    return FailHere(fmt::format("{} should be here, from 0 to {}, not {}", what, most, Quoted(word)));
  Skip();
  return static_cast<uint32_t>(value);
}

}  // namespace quarry

#include "preprocess/import/ply/ply_rows.h"

#include <fmt/format.h>

#include "preprocess/import/text/text_number.h"

namespace quarry {

bool AsciiPlySource::Word(std::string_view& word) {
  while (true) {
    if (!bytes_.Ensure(kLongestWord) && bytes_.available() == 0) return false;
    const std::string_view seen = bytes_.view().substr(0, kLongestWord);
    size_t begin = 0;
    for (; begin < seen.size() && IsSpace(seen[begin]); ++begin) line_ += seen[begin] == '\n';
    bytes_.Consume(begin);
    if (begin == seen.size()) continue;
    if (!bytes_.Ensure(kLongestWord) && bytes_.available() == 0) return false;
    const std::string_view rest = bytes_.view().substr(0, kLongestWord);
    size_t length = 0;
    while (length < rest.size() && !IsSpace(rest[length])) ++length;
    word = rest.substr(0, length);
    bytes_.Consume(length);
    return true;
  }
}

bool AsciiPlySource::Scalar(PlyType, double& value) {
  std::string_view word;
  if (!Word(word)) return false;
  TextCursor cursor(word);
  if (ParseReal(cursor, value)) return true;
  complaint_ = Quoted(word) + " is not a number";
  return false;
}

bool AsciiPlySource::Integer(PlyType, int64_t& value) {
  std::string_view word;
  if (!Word(word)) return false;
  TextCursor cursor(word);
  if (ParseInteger(cursor, value) && cursor.next == cursor.end) return true;
  complaint_ = Quoted(word) + " is not an integer";
  return false;
}

bool AsciiPlySource::Integers(PlyType type, uint64_t count, std::vector<int64_t>& out) {
  for (uint64_t i = 0; i < count; ++i) {
    int64_t value;
    if (!Integer(type, value)) return false;
    out.push_back(value);
  }
  return true;
}

bool AsciiPlySource::SkipValues(PlyType, uint64_t count) {
  std::string_view word;
  for (uint64_t i = 0; i < count; ++i)
    if (!Word(word)) return false;
  return true;
}

void AsciiPlySource::LookForRows(uint64_t rows) {
  const bool goes_on = bytes_.Ensure(ModelReader::kBufferBytes);
  uint64_t lines = 0;
  bool blank = true;
  for (const char c : bytes_.view()) {
    if (c != '\n' && c != '\r') {
      blank &= IsSpace(c);
      continue;
    }
    lines += !blank;
    blank = true;
  }
  by_line_ = lines + !blank >= rows || (goes_on && lines > 1);
}

bool AsciiPlySource::EndRow() {
  bool more = false;
  if (!by_line_) return more;
  while (bytes_.Ensure(1)) {
    const char next = bytes_.data()[0];
    if (next == '\n' || next == '\r') break;
    more |= !IsSpace(next);
    bytes_.Consume(1);
  }
  return more;
}

tl::unexpected<Error> AsciiPlySource::Failure(const std::string& where) const {
  if (!complaint_.empty()) return FailHere(complaint_ + " in " + where);
  if (bytes_.failed()) return bytes_.Truncated("");
  return FailHere("the file ends in " + where);
}

tl::unexpected<Error> AsciiPlySource::FailHere(const std::string& what) const {
  return Fail(fmt::format("{}, line {}: {}", bytes_.path(), line_, what));
}

}  // namespace quarry

#include "preprocess/import/line_reader.h"

#include <fmt/format.h>

#include <cstring>

namespace quarry {
namespace {

void TrimCarriageReturn(std::string_view& line) {
  if (line.ends_with('\r')) line.remove_suffix(1);
}

}  // namespace

void LineReader::SkipByteOrderMark() {
  if (bytes_.Ensure(3) && bytes_.view().starts_with("\xEF\xBB\xBF")) bytes_.Consume(3);
}

Result<bool> LineReader::Next(std::string_view& line) {
  if (bytes_.offset() == 0) SkipByteOrderMark();
  ++line_number_;
  size_t searched = 0;
  do {
    const std::string_view seen = bytes_.view();
    const void* found = std::memchr(seen.data() + searched, '\n', seen.size() - searched);
    if (found != nullptr) {
      line = seen.substr(0, static_cast<const char*>(found) - seen.data());
      bytes_.Consume(line.size() + 1);
      TrimCarriageReturn(line);
      return true;
    }
    if (seen.size() == kLongestLine)
      return FailHere("is longer than 1 MiB, so this is no text file of a model");
    searched = seen.size();
  } while (bytes_.Ensure(searched + 1));
  if (bytes_.failed()) return bytes_.Truncated("");
  line = bytes_.view();
  bytes_.Consume(line.size());
  TrimCarriageReturn(line);
  return !line.empty();
}

Result<bool> LineReader::NextJoined(std::string_view& line) {
  auto more = Next(line);
  if (!more || !*more || !line.ends_with('\\') || line.starts_with('#')) [[likely]]
    return more;
  return JoinFollowing(line);
}

Result<bool> LineReader::JoinFollowing(std::string_view& line) {
  joined_.clear();
  while (line.ends_with('\\')) {
    joined_.append(line.substr(0, line.size() - 1)).push_back(' ');
    if (joined_.size() > kLongestLine) return FailHere("continues a line to more than 1 MiB");
    QUARRY_ASSIGN(const bool more, Next(line));
    if (!more) line = {};
  }
  joined_.append(line);
  line = joined_;
  return true;
}

tl::unexpected<Error> LineReader::FailHere(const std::string& what) const {
  return Fail(fmt::format("{}, line {}: {}", bytes_.path(), line_number_, what));
}

}  // namespace quarry

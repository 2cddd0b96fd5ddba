#include "preprocess/import/text/line_reader.h"

#include <fmt/format.h>

#include <cstring>

#include "preprocess/import/text/text_number.h"

namespace quarry {
namespace {

/// Whether the last character before trailing blanks is a backslash.
bool IsContinued(std::string_view line) {
  const size_t last = line.find_last_not_of(" \t");
  return last != std::string_view::npos && line[last] == '\\';
}

/// Whether the line ends in a comment or a name, where a backslash is an ordinary character.
bool IsCommentOrName(std::string_view line) {
  for (size_t at = line.find('#'); at != line.npos; at = line.find('#', at + 1))
    if (at == 0 || IsBlank(line[at - 1])) return true;
  const std::string_view word = TextCursor(line).Word();
  return word == "g" || word == "o" || EqualsIgnoringCase(word, "usemtl") ||
         EqualsIgnoringCase(word, "newmtl");
}

}  // namespace

void LineReader::SkipByteOrderMark() {
  if (bytes_.Ensure(3) && bytes_.view().starts_with("\xEF\xBB\xBF")) bytes_.Consume(3);
}

bool LineReader::TakeLine(std::string_view seen, size_t searched, std::string_view& line) {
  const void* found = std::memchr(seen.data() + searched, end_, seen.size() - searched);
  line = found != nullptr ? seen.substr(0, static_cast<const char*>(found) - seen.data()) : seen;
  // The other line end may come first; CR before LF belongs to it.
  const char other = end_ == '\n' ? '\r' : '\n';
  const void* earlier = line.empty() ? nullptr : std::memchr(line.data(), other, line.size());
  const auto at =
      earlier != nullptr ? static_cast<size_t>(static_cast<const char*>(earlier) - line.data()) : line.size();
  if (found != nullptr && (earlier == nullptr || (other == '\r' && at + 1 == line.size()))) {
    bytes_.Consume(line.size() + 1);
    line = line.substr(0, at);
    return true;
  }
  // The last buffered byte may be half of CR LF.
  if (earlier == nullptr || (found == nullptr && at + 1 == line.size())) return false;
  end_ = other;
  line = line.substr(0, at);
  bytes_.Consume(at + 1);
  return true;
}

Result<bool> LineReader::Next(std::string_view& line) {
  if (bytes_.offset() == 0) SkipByteOrderMark();
  ++line_number_;
  size_t searched = 0;
  do {
    const std::string_view seen = bytes_.view();
    if (TakeLine(seen, searched, line)) return true;
    if (seen.size() == kLongestLine)
      return FailHere("is longer than 1 MiB, so this is not a text file of a model");
    searched = seen.size();
  } while (bytes_.Ensure(searched + 1));
  if (bytes_.failed()) return bytes_.Truncated("");
  line = bytes_.view();
  bytes_.Consume(line.size());
  while (line.ends_with('\r') || line.ends_with('\n')) line.remove_suffix(1);
  return !line.empty();
}

Result<bool> LineReader::NextJoined(std::string_view& line) {
  auto more = Next(line);
  if (!more || !*more || !IsContinued(line) || IsCommentOrName(line)) [[likely]]
    return more;
  return JoinFollowing(line);
}

Result<bool> LineReader::JoinFollowing(std::string_view& line) {
  joined_.clear();
  while (IsContinued(line) && !IsCommentOrName(line)) {
    joined_.append(line.substr(0, line.rfind('\\'))).push_back(' ');
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

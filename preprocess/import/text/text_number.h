#pragma once

#include <charconv>
#include <cstdint>
#include <limits>
#include <string>
#include <string_view>

namespace quarry {

/// Space, tab, and characters that stray editors leave at the ends of lines.
inline bool IsBlank(char c) { return c == ' ' || c == '\t' || c == '\r' || c == '\v' || c == '\f'; }

/// Blanks and line ends.
inline bool IsSpace(char c) { return IsBlank(c) || c == '\n'; }

/// A position in a line of text.
struct TextCursor {
  const char* next;
  const char* end;

  explicit TextCursor(std::string_view text) : next(text.data()), end(text.data() + text.size()) {}

  void SkipBlanks() {
    while (next != end && IsBlank(*next)) ++next;
  }
  /// Whether only blanks or a comment are left.
  bool AtEnd() {
    SkipBlanks();
    return next == end || *next == '#';
  }
  /// The next run of characters that are not blank; empty at the end.
  std::string_view Word() {
    SkipBlanks();
    const char* begin = next;
    while (next != end && !IsBlank(*next)) ++next;
    return {begin, static_cast<size_t>(next - begin)};
  }
  /// The rest of the line, trimmed.
  std::string_view Rest() {
    SkipBlanks();
    const char* last = end;
    while (last != next && IsBlank(last[-1])) --last;
    return {next, static_cast<size_t>(last - next)};
  }
  /// The rest of the line without a comment, which begins at '#' between blanks: "Material #25" is a name.
  std::string_view Name() {
    const std::string_view rest = Rest();
    for (size_t i = 0; i < rest.size(); ++i)
      if (rest[i] == '#' && (i == 0 || IsBlank(rest[i - 1])) &&
          (i + 1 == rest.size() || IsBlank(rest[i + 1])))
        return TextCursor(rest.substr(0, i)).Rest();
    return rest;
  }
};

/// Parses numbers that std::from_chars refuses: beyond double's range, and "1.#INF" and "1.#QNAN" of old
/// Windows runtimes. False: other text.
bool ParseUnusualReal(std::string_view word, double& value);

/// Parses a real number after blanks and moves behind it: any decimal syntax, a leading '+', nan, inf. False,
/// with the cursor at the first character: there is none, or it runs into other text.
inline bool ParseReal(TextCursor& cursor, double& value) {
  cursor.SkipBlanks();
  const char* begin = cursor.next;
  if (begin != cursor.end && *begin == '+') ++begin;
  const auto [stop, error] = std::from_chars(begin, cursor.end, value);
  if (error == std::errc() && (stop == cursor.end || IsSpace(*stop))) [[likely]] {
    cursor.next = stop;
    return true;
  }
  TextCursor rest = cursor;
  if (!ParseUnusualReal(rest.Word(), value)) return false;
  cursor.next = rest.next;
  return true;
}

/// Parses a decimal integer at the cursor, without skipping blanks, and moves behind it; a leading '+' is
/// allowed. Does not look at the character after it. Values beyond 64 bits are clamped.
inline bool ParseInteger(TextCursor& cursor, int64_t& value) {
  const char* begin = cursor.next;
  if (cursor.end - begin > 1 && *begin == '+' && begin[1] != '-') ++begin;
  const auto [stop, error] = std::from_chars(begin, cursor.end, value);
  if (error == std::errc::invalid_argument) return false;
  if (error == std::errc::result_out_of_range)
    value = *begin == '-' ? std::numeric_limits<int64_t>::min() : std::numeric_limits<int64_t>::max();
  cursor.next = stop;
  return true;
}

/// `text` in quotation marks for an error sentence: at most 40 bytes, as PrintableName() shows them, so that
/// names in encodings other than UTF-8 appear as bytes.
std::string Quoted(std::string_view text);

/// Whether the texts are equal but for the case of ASCII letters.
bool EqualsIgnoringCase(std::string_view a, std::string_view b);

}  // namespace quarry

#include "preprocess/import/text/text_number.h"

#include <algorithm>

#include "common/base/log.h"

namespace quarry {
namespace {

char Lower(char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; }

bool StartsWith(std::string_view text, std::string_view prefix) {
  return text.size() >= prefix.size() && EqualsIgnoringCase(text.substr(0, prefix.size()), prefix);
}

/// The value of a decimal number that double cannot hold: infinity or zero, by the place of its digits.
double OutOfRangeValue(std::string_view digits) {
  const size_t exponent = digits.find_first_of("eE");
  const bool tiny = exponent != std::string_view::npos ? digits.substr(exponent + 1).starts_with('-')
                                                       : digits.starts_with('0') || digits.starts_with('.');
  return tiny ? 0.0 : std::numeric_limits<double>::infinity();
}

}  // namespace

bool ParseUnusualReal(std::string_view word, double& value) {
  if (word.starts_with('+')) word.remove_prefix(1);
  const double sign = word.starts_with('-') ? -1.0 : 1.0;
  const std::string_view digits = sign < 0 ? word.substr(1) : word;
  if (StartsWith(digits, "1.#INF")) {
    value = sign * std::numeric_limits<double>::infinity();
    return true;
  }
  if (StartsWith(digits, "1.#")) {
    value = std::numeric_limits<double>::quiet_NaN();
    return true;
  }
  const auto [stop, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc::result_out_of_range || stop != word.data() + word.size()) return false;
  value = sign * OutOfRangeValue(digits);
  return true;
}

std::string Quoted(std::string_view text) {
  constexpr size_t kLongest = 40;
  size_t length = std::min(text.size(), kLongest);
  const auto continues = [&](size_t at) { return at < text.size() && (text[at] & 0xC0) == 0x80; };
  for (int i = 0; i < 3 && length > 0 && continues(length); ++i) --length;  // no letter is cut
  return '"' + PrintableName(text.substr(0, length)) + (length < text.size() ? "...\"" : "\"");
}

bool EqualsIgnoringCase(std::string_view a, std::string_view b) {
  return std::ranges::equal(a, b, {}, Lower, Lower);
}

}  // namespace quarry

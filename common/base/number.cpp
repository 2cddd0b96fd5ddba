#include "common/base/number.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace quarry {
namespace {

/// Parses decimal digits without a leading zero: option parsers would read that number as octal.
template <class Whole>
bool ParseWhole(std::string_view text, Whole& out) {
  if (text.empty() || (text.size() > 1 && text[0] == '0')) return false;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, out);
  return error == std::errc{} && rest == end;  // unsigned: from_chars accepts no sign
}

/// "; write 1000000" when `text` is a number with the suffix of a size, else empty.
std::string Written(std::string_view text) {
  const size_t suffix =
      std::string_view("kmg").find(text.empty() ? ' ' : static_cast<char>(text.back() | 0x20));
  double value = 0;
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  if (suffix == std::string_view::npos || error != std::errc{} || rest + 1 != end ||
      !(value >= 0 && value < 1e9))
    return "";
  return fmt::format("; write {:.0f}", value * std::pow(1000.0, static_cast<double>(suffix + 1)));
}

}  // namespace

NumberCheck WholeNumber(uint64_t least, uint64_t most) {
  return [=](const std::string& text) -> std::string {
    uint64_t value = 0;
    if (ParseWhole(text, value) && value >= least && value <= most) return "";
    return fmt::format("'{}' is not a whole number from {} to {}{}", text, least, most, Written(text));
  };
}

NumberCheck RealNumber(double least, double most) {
  return [=](const std::string& text) -> std::string {
    double value = 0;
    const char* const end = text.data() + text.size();
    const auto [rest, error] = std::from_chars(text.data(), end, value);
    if (error == std::errc{} && rest == end && value >= least && value <= most) return "";
    return fmt::format("'{}' is not a number from {} to {}", text, least, most);
  };
}

bool ParseCounts(std::string_view text, std::string_view separators, std::span<uint32_t> out) {
  for (size_t i = 0; i < separators.size(); ++i) {
    const size_t at = text.find(separators[i]);
    if (at == std::string_view::npos || !ParseWhole(text.substr(0, at), out[i])) return false;
    text.remove_prefix(at + 1);
  }
  return ParseWhole(text, out[separators.size()]);
}

}  // namespace quarry

#include "common/base/size.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>

namespace quarry {
namespace {

/// Bytes per unit for the suffixes K, M, G and T in either case, with or without "B" or "iB". 1 for "B" and
/// no suffix; 0 for any other suffix.
double UnitOf(std::string_view suffix) {
  if (suffix.ends_with('B') || suffix.ends_with('b')) suffix.remove_suffix(1);
  const bool binary = suffix.size() == 2 && suffix.ends_with('i');
  if (binary) suffix.remove_suffix(1);
  if (suffix.empty()) return 1;
  const size_t power = std::string_view("kmgt").find(static_cast<char>(suffix[0] | 0x20));
  if (suffix.size() != 1 || power == std::string_view::npos) return 0;
  return std::exp2(10.0 * static_cast<double>(power + 1));
}

}  // namespace

Result<uint64_t> ParseSize(std::string_view text, std::string_view what) {
  double value = 0;
  const char* end = text.data() + text.size();
  auto [rest, ec] = std::from_chars(text.data(), end, value);
  const double unit = UnitOf({rest, static_cast<size_t>(end - rest)});
  if (ec != std::errc{} || unit == 0 || !(value >= 0) || value * unit > 4.6e18)
    return BadUsage(
        fmt::format("{} is not a size: '{}' (give bytes, or a number with K, M, G or T)", what, text));
  return static_cast<uint64_t>(value * unit);
}

std::string FormatSize(uint64_t bytes) {
  if (bytes < 1024) return fmt::format("{} bytes", bytes);
  const char* const units[] = {"KiB", "MiB", "GiB", "TiB"};
  double value = static_cast<double>(bytes) / 1024;
  int unit = 0;
  while (value >= 1024 && unit < 3) {
    value /= 1024;
    ++unit;
  }
  return fmt::format("{:.{}f} {}", value, value < 10 ? 2 : value < 100 ? 1 : 0, units[unit]);
}

}  // namespace quarry

#include "common/base/size.h"

#include <fmt/format.h>

#include <charconv>

namespace quarry {

Result<uint64_t> ParseSize(std::string_view text, std::string_view what) {
  double value = 0;
  const char* end = text.data() + text.size();
  auto [rest, ec] = std::from_chars(text.data(), end, value);
  std::string_view suffix(rest, static_cast<size_t>(end - rest));
  double unit = 0;
  if (suffix.empty()) unit = 1;
  if (suffix == "K") unit = 1024.0;
  if (suffix == "M") unit = 1024.0 * 1024;
  if (suffix == "G") unit = 1024.0 * 1024 * 1024;
  if (ec != std::errc{} || unit == 0 || !(value >= 0) || value * unit > 4.6e18)
    return BadUsage(
        fmt::format("{} is not a size: '{}' (give bytes, or a number with K, M or G)", what, text));
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

#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry {

/// Parses a size in bytes: "256M", "1G", "64k", "512MB", "2TiB", "4096", "1.5G". K, M, G and T are always
/// powers of 2.
/// Errors (usage; the message names `what`): not a number; another suffix; negative; above 2^62.
Result<uint64_t> ParseSize(std::string_view text, std::string_view what);

/// A size for people with three digits: "1.5 GiB", "75.0 KiB", "12 bytes".
std::string FormatSize(uint64_t bytes);

}  // namespace quarry

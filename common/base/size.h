#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/base/status.h"

namespace quarry {

/// Bytes from "256M", "1G", "64k", "512MB", "2TiB" or "4096" (K, M, G, T are powers of 2 however they are
/// written; fractions such as "1.5G" are taken).
/// Errors (usage): not a number, another suffix, negative, beyond 2^62; the sentence names `what`.
Result<uint64_t> ParseSize(std::string_view text, std::string_view what);

/// "1.5 GiB", "75.0 KiB", "12 bytes": for people, three digits.
std::string FormatSize(uint64_t bytes);

}  // namespace quarry

#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace quarry {

/// Checks an option's text. Returns: the error's sentence, or empty. The type that CLI::Option::check()
/// takes.
using NumberCheck = std::function<std::string(const std::string&)>;

/// Accepts a whole number in decimal digits in [least, most]: no sign, no other base, no overflow.
NumberCheck WholeNumber(uint64_t least, uint64_t most);
/// Accepts a finite number in [least, most].
NumberCheck RealNumber(double least, double most);

/// Parses whole numbers between the given separators: "640x480" with "x" gives two, "1,2,3,4" with ",,,"
/// gives four. Returns: false for any other text, a sign, or a number above 2^32 - 1.
/// Requires: out.size() == separators.size() + 1.
bool ParseCounts(std::string_view text, std::string_view separators, std::span<uint32_t> out);

}  // namespace quarry

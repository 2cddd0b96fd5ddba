#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>

namespace quarry {

/// What is wrong with an option's text; empty when nothing is. CLI::Option::check() takes these.
using NumberCheck = std::function<std::string(const std::string&)>;

/// A whole number in decimal digits: no sign, no other base, nothing that wraps round.
NumberCheck WholeNumber(uint64_t least, uint64_t most);
/// A number that is one (no nan, no infinity).
NumberCheck RealNumber(double least, double most);

/// "640x480" with the separators "x" into two numbers, "1,2,3,4" with ",,," into four. False: it is anything
/// else; a number has a sign or goes beyond 2^32 - 1. Requires: out.size() == separators.size() + 1.
bool ParseCounts(std::string_view text, std::string_view separators, std::span<uint32_t> out);

}  // namespace quarry

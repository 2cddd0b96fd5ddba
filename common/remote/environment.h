#pragma once

#include <initializer_list>
#include <string>
#include <string_view>

namespace quarry {

/// The value of the first of these variables that is set and not empty; else empty.
std::string Environment(std::initializer_list<const char*> names);

/// ASCII letters made small.
std::string Lower(std::string_view text);

/// Text without blanks and tabs at its ends.
std::string_view Trimmed(std::string_view text);

/// Decodes "%20" and the like.
std::string PercentDecodedText(std::string_view text);

}  // namespace quarry

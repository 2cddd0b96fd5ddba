#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

// What an HTTP server's answer means to whoever asked for a range of bytes.

namespace quarry {

/// The part of a file that an answer holds: bytes `first` to `last`.
struct ContentRange {
  uint64_t first = 0, last = 0;
  uint64_t file_size = 0;  ///< bytes; 0: not told
};

/// Decodes "bytes 0-63/4096" or "bytes 0-63/*"; nothing where it is anything else, or reaches beyond the
/// file.
std::optional<ContentRange> DecodeContentRange(std::string_view text);

/// Whether a status other than 206 is one that stays the same however often one asks.
bool IsPermanentStatus(unsigned status);

/// What a status other than 206 says, with what to do about it: "answers 404 Not Found". Of the server's own
/// words it has none.
std::string StatusSentence(unsigned status);

}  // namespace quarry

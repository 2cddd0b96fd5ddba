#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

// The meaning of an HTTP server's answer to a request for a range of bytes. Thread-safe.

namespace quarry {

/// The part of a file that an answer holds: bytes `first` to `last`, inclusive.
struct ContentRange {
  uint64_t first = 0, last = 0;
  uint64_t file_size = 0;  ///< bytes; 0 when the server does not tell
};

/// Decodes "bytes 0-63/4096" or "bytes 0-63/*". Returns: nothing for other text, or a range beyond the file.
/// Source: RFC 9110, section 14.4.
std::optional<ContentRange> DecodeContentRange(std::string_view text);

/// Whether a retry cannot change a status. Requires: status != 206.
bool IsPermanentStatus(unsigned status);

/// A sentence for a status and its remedy: "answers 404 Not Found". It contains no text from the server.
/// Requires: status != 206.
std::string StatusSentence(unsigned status);

}  // namespace quarry

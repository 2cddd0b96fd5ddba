#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/base/status.h"
#include "common/remote/http_options.h"

namespace quarry {

/// The Content-Range of a partial answer. Units: bytes.
struct ContentRange {
  uint64_t first = 0, last = 0;  ///< both inclusive
  uint64_t file_size = 0;        ///< 0: unknown
};

/// Parses "bytes FIRST-LAST/SIZE" or "bytes FIRST-LAST/*". Returns: nothing for anything else (another unit,
/// spaces, a range beyond the size).
std::optional<ContentRange> DecodeContentRange(std::string_view text);

/// Whether asking again cannot help: anything but 5xx, 408, 425 and 429.
bool IsPermanentStatus(unsigned status);

/// The error code that the beginning of an answer's body has, as S3 and its like give it:
/// "<Code>ExpiredToken</Code>" or "code": "ExpiredToken". Empty: there is none of letters and digits.
std::string CodeOf(std::string_view body);

/// A sentence for a status and the server's code, with the remedy: "answers 403 Forbidden (ExpiredToken): the
/// credentials have expired". Of the server's text it has the code alone.
/// Requires: status != 206; `code` is CodeOf()'s.
std::string StatusSentence(unsigned status, const std::string& code);

/// Whether a status sends the client elsewhere.
bool IsRedirection(unsigned status);
/// The address that an answer from `from` sends to: absolute, or relative to `from`.
/// Errors (permanent): no address; another scheme; from https to http.
Result<HttpLocation> RedirectedTo(const HttpLocation& from, std::string_view target);

/// Whether two addresses are of one server: the same scheme, host and port.
bool SameServer(const HttpLocation& a, const HttpLocation& b);

}  // namespace quarry

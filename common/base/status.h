#pragma once

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace quarry {

/// What went wrong, as one sentence for the person at the terminal: what, where (file, line or byte), what to
/// do. `exit_status` is what the program should end with: 1 failed, 2 unusable arguments. `permanent`: trying
/// again cannot help (the other side speaks another version, say).
struct Error {
  std::string message;
  int exit_status = 1;
  bool permanent = false;
};

/// The value, or the Error that kept it from being. Used for every fallible read of disk, wire and user
/// input; exceptions stop at thread and session boundaries.
template <typename T>
using Result = tl::expected<T, Error>;

/// Success, or an Error.
using Status = Result<void>;

inline tl::unexpected<Error> Fail(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message), 1});
}

inline tl::unexpected<Error> BadUsage(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message), 2});
}

/// The errno text, e.g. "No space left on device".
std::string ErrnoText(int error_number);

}  // namespace quarry

#define QUARRY_CONCAT_INNER(a, b) a##b
#define QUARRY_CONCAT(a, b) QUARRY_CONCAT_INNER(a, b)

/// Leaves the calling function with the error of `expression` (a Status), if it has one. In a lambda, give
/// the return type: `-> Status`.
#define QUARRY_TRY(expression)                                                                            \
  do {                                                                                                    \
    if (auto QUARRY_CONCAT(quarry_status_, __LINE__) = (expression);                                      \
        !QUARRY_CONCAT(quarry_status_, __LINE__))                                                         \
      return tl::unexpected<::quarry::Error>(std::move(QUARRY_CONCAT(quarry_status_, __LINE__).error())); \
  } while (false)

/// Declares `lhs` from the value of `expression` (a Result<T>), or leaves the calling function with its
/// error.
#define QUARRY_ASSIGN(lhs, expression)                                                                  \
  auto QUARRY_CONCAT(quarry_result_, __LINE__) = (expression);                                          \
  if (!QUARRY_CONCAT(quarry_result_, __LINE__))                                                         \
    return tl::unexpected<::quarry::Error>(std::move(QUARRY_CONCAT(quarry_result_, __LINE__).error())); \
  lhs = std::move(*QUARRY_CONCAT(quarry_result_, __LINE__))

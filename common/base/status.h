#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace quarry {

/// The reason of a failure, for programs. People read the message.
enum class ErrorKind : uint8_t {
  kFailed,        ///< any other reason
  kUsage,         ///< unusable arguments
  kPermanent,     ///< a retry cannot help: another version, another scene, damaged data
  kCannotResume,  ///< kept work does not fit; the message advises to start again
  kCancelled,     ///< the caller asked to cancel
  kMemory,        ///< no memory is left, or the system refuses a thread
};

/// A failure. `message` is one sentence for the person at the terminal: the subject, the place (file, line or
/// byte) and the remedy.
struct Error {
  std::string message;
  ErrorKind kind = ErrorKind::kFailed;

  /// The program's exit status: 1 for a failure, 2 for unusable arguments.
  int exit_status() const { return kind == ErrorKind::kUsage ? 2 : 1; }
  bool permanent() const { return kind == ErrorKind::kPermanent; }
};

/// A value, or the Error that prevented it. Used for every fallible read of disk, network and user input.
/// Exceptions stop at thread and session boundaries.
template <typename T>
using Result = tl::expected<T, Error>;

/// Success or an Error.
using Status = Result<void>;

inline tl::unexpected<Error> Fail(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message)});
}

/// The kind of error of a program that ended with `exit_status`. Requires: exit_status != 0.
inline ErrorKind KindOfExit(int exit_status) {
  return exit_status == 2 ? ErrorKind::kUsage : ErrorKind::kFailed;
}

inline tl::unexpected<Error> BadUsage(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message), ErrorKind::kUsage});
}

/// Work of an earlier run that does not fit. `reason`: a sentence without its end, to which the remedy is
/// added.
inline tl::unexpected<Error> CannotResume(const std::string& reason) {
  return tl::unexpected<Error>(Error{reason + "; start again without --resume", ErrorKind::kCannotResume});
}

/// The text of an errno value: "No space left on device".
std::string ErrnoText(int error_number);

}  // namespace quarry

#define QUARRY_CONCAT_INNER(a, b) a##b
#define QUARRY_CONCAT(a, b) QUARRY_CONCAT_INNER(a, b)

/// Returns from the calling function with the error of `expression` (a Status) if it has one. A lambda needs
/// the return type `-> Status`.
#define QUARRY_TRY(expression)                                                                            \
  do {                                                                                                    \
    if (auto QUARRY_CONCAT(quarry_status_, __LINE__) = (expression);                                      \
        !QUARRY_CONCAT(quarry_status_, __LINE__))                                                         \
      return tl::unexpected<::quarry::Error>(std::move(QUARRY_CONCAT(quarry_status_, __LINE__).error())); \
  } while (false)

/// Declares `lhs` from the value of `expression` (a Result<T>), or returns from the calling function with its
/// error.
#define QUARRY_ASSIGN(lhs, expression)                                                                  \
  auto QUARRY_CONCAT(quarry_result_, __LINE__) = (expression);                                          \
  if (!QUARRY_CONCAT(quarry_result_, __LINE__))                                                         \
    return tl::unexpected<::quarry::Error>(std::move(QUARRY_CONCAT(quarry_result_, __LINE__).error())); \
  lhs = std::move(*QUARRY_CONCAT(quarry_result_, __LINE__))

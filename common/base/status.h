#pragma once

#include <cstdint>
#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace quarry {

/// Why something failed, for programs; people read the message.
enum class ErrorKind : uint8_t {
  kFailed,        ///< anything else
  kUsage,         ///< unusable arguments
  kPermanent,     ///< trying again cannot help: another version, another scene, damage
  kCannotResume,  ///< kept work does not fit; the message says to begin anew
  kCancelled,     ///< the caller has asked for it
};

/// A failure as one sentence for the person at the terminal: its subject, the place (file, line or byte), the
/// remedy.
struct Error {
  std::string message;
  ErrorKind kind = ErrorKind::kFailed;

  /// The status that a program ends with: 1 failed, 2 unusable arguments.
  int exit_status() const { return kind == ErrorKind::kUsage ? 2 : 1; }
  bool permanent() const { return kind == ErrorKind::kPermanent; }
};

/// The value, or the Error that kept it from being. Used for every fallible read of disk, wire and user
/// input; exceptions stop at thread and session boundaries.
template <typename T>
using Result = tl::expected<T, Error>;

/// Success, or an Error.
using Status = Result<void>;

inline tl::unexpected<Error> Fail(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message)});
}

/// For a program that has ended with `exit_status`, which is not 0.
inline ErrorKind KindOfExit(int exit_status) {
  return exit_status == 2 ? ErrorKind::kUsage : ErrorKind::kFailed;
}

inline tl::unexpected<Error> BadUsage(std::string message) {
  return tl::unexpected<Error>(Error{std::move(message), ErrorKind::kUsage});
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

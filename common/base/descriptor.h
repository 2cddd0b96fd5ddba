#pragma once

#include <cstddef>
#include <span>

namespace quarry {

/// Reads until `out` is full. Returns: false at the end of the data and after an error. Thread-safe.
bool ReadAll(int fd, std::span<std::byte> out);
/// Writes all of `bytes`. Returns: false after an error. The caller handles SIGPIPE. Thread-safe.
bool WriteAll(int fd, std::span<const std::byte> bytes);

}  // namespace quarry

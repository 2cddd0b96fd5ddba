#pragma once

#include <cstddef>
#include <span>

namespace quarry {

/// Reads until `out` is full. False at the end of what there is, and after an error. Thread-safe.
bool ReadAll(int fd, std::span<std::byte> out);
/// Writes all of it. False after an error; SIGPIPE is the caller's concern. Thread-safe.
bool WriteAll(int fd, std::span<const std::byte> bytes);

}  // namespace quarry

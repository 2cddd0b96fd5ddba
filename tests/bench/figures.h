#pragma once

#include <fmt/format.h>

#include <cerrno>
#include <cstdio>
#include <string>
#include <system_error>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/output_path.h"

namespace quarry::bench {

/// What is wrong with a benchmark's --json, told before it runs; CLI::Option::check() takes it.
inline std::string CheckFigures(const std::string& path) {
  OutputGuard guard(OutputGuard::Force::kNotOffered);
  const auto place = guard.Take(path, kFiguresOutput);
  const Status writable = place ? CheckWritable(*place) : tl::unexpected<Error>(place.error());
  return writable ? "" : writable.error().message;
}

/// Writes figures to `path`, unless that is empty. False, and a sentence, when it cannot be done.
inline bool WriteFigures(const std::string& path, const std::string& json) {
  if (path.empty()) return true;
  const Status written = WriteFileAtomically(path, AsBytes(json + "\n"));
  if (!written) fmt::print(stderr, "{}\n", written.error().message);
  return written.has_value();
}

/// Runs a program that prints tables. Returns: its exit status; 1, and a sentence, when standard output
/// cannot be written or the system refuses something else.
template <class Run>
int RunPrinting(const char* program, const Run& run) {
  const auto not_written = [&](int error) {
    fmt::print(stderr, "{}: the tables cannot be written: {}\n", program, ErrnoText(error));
    return 1;
  };
  try {
    const int status = run();
    return std::fflush(stdout) == 0 ? status : not_written(errno);
  } catch (const std::system_error& error) {
    if (std::ferror(stdout)) return not_written(error.code().value());  // thrown by fmt::print
    fmt::print(stderr, "{}: {}\n", program, error.what());
    return 1;
  }
}

}  // namespace quarry::bench

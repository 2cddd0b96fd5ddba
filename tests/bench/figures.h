#pragma once

#include <string>

#include "common/base/bytes.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/output_path.h"

namespace quarry::bench {

/// Checks a benchmark's --json before the benchmark runs, for CLI::Option::check(). Returns the fault; empty:
/// none.
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
  if (!written) Log(written.error().message);
  return written.has_value();
}

}  // namespace quarry::bench

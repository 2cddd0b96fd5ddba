#pragma once

#include <sys/resource.h>

#include <chrono>

#include "common/base/resource.h"

namespace quarry::bench {

using Clock = std::chrono::steady_clock;

/// Processor seconds that this process has had.
inline double ProcessSeconds() {
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec) * 1e-6;
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

}  // namespace quarry::bench

#pragma once

#include <span>
#include <string>
#include <utility>
#include <vector>

namespace quarry {

/// A value for Prometheus. Names follow its rules: the unit in the name, counters end in "_total".
struct Metric {
  enum class Kind { kCounter, kGauge };
  const char* name;
  const char* help;
  Kind kind = Kind::kGauge;
  double value = 0;
  std::vector<std::pair<std::string, std::string>> labels;
};
/// The type of the answer that has FormatMetrics().
inline constexpr const char* kMetricsType = "text/plain; version=0.0.4; charset=utf-8";

/// The metrics, and "quarry_build_info" with the program's version, in Prometheus' text format 0.0.4.
/// Requires: metrics of one name follow each other. Thread-safe.
std::string FormatMetrics(std::span<const Metric> metrics);

}  // namespace quarry

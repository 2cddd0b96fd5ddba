#include "common/http/metrics.h"

#include <prometheus/text_serializer.h>

#include "common/base/version.h"

namespace quarry {
namespace {

void Append(const Metric& metric, std::vector<prometheus::MetricFamily>& families) {
  const bool counter = metric.kind == Metric::Kind::kCounter;
  if (families.empty() || families.back().name != metric.name) {
    prometheus::MetricFamily& family = families.emplace_back();
    family.name = metric.name;
    family.help = metric.help;
    family.type = counter ? prometheus::MetricType::Counter : prometheus::MetricType::Gauge;
  }
  prometheus::ClientMetric& value = families.back().metric.emplace_back();
  (counter ? value.counter.value : value.gauge.value) = metric.value;
  for (const auto& [name, text] : metric.labels) value.label.push_back({name, text});
}

}  // namespace

std::string FormatMetrics(std::span<const Metric> metrics) {
  std::vector<prometheus::MetricFamily> families;
  for (const Metric& metric : metrics) Append(metric, families);
  Append({.name = "quarry_build_info",
          .help = "The program's version",
          .value = 1,
          .labels = {{"version", kVersion}}},
         families);
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace quarry

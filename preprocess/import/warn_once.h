#pragma once

#include <set>
#include <string>

#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives each warning of a file to the sink once, and at most a thousand: garbage must neither flood the
/// terminal nor fill memory. `sink` must outlive it. Thread safety: none.
class WarnOnce {
 public:
  explicit WarnOnce(ModelSink& sink) : sink_(sink) {}
  void operator()(const std::string& message) {
    constexpr size_t kMost = 1000;
    if (warned_.size() < kMost && warned_.insert(message).second) sink_.Warn(message);
  }

 private:
  ModelSink& sink_;
  std::set<std::string> warned_;
};

}  // namespace quarry

#pragma once

#include <set>
#include <string>

#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives each of a file's warnings to the sink once, and no more than a thousand: a file of garbage must
/// neither flood the terminal nor fill the memory. `sink` must outlive it. Not thread-safe.
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

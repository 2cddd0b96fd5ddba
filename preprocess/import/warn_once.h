#pragma once

#include <fmt/format.h>

#include <map>
#include <set>
#include <string>
#include <vector>

#include "preprocess/import/model_sink.h"

namespace quarry {

/// Gives each warning of a file to the sink once. Of warnings that differ only in quoted names, in numbers
/// and in the words of their place the first is given at once, and the others together, when this is
/// destroyed. At most a thousand kinds: garbage must neither flood the terminal nor fill memory. `sink` must
/// outlive it. Thread safety: none.
class WarnOnce {
 public:
  explicit WarnOnce(ModelSink& sink) : sink_(sink) {}
  WarnOnce(const WarnOnce&) = delete;
  ~WarnOnce() {
    try {
      for (auto& [kind, like] : kinds_) GiveOthers(like);
    } catch (...) {  // no memory for a warning
    }
  }

  void operator()(const std::string& message) {
    constexpr size_t kMostKinds = 1000, kMostRemembered = 10000;
    if (warned_.size() >= kMostRemembered || !warned_.insert(message).second) return;
    auto [text, names] = KindOf(message);
    if (kinds_.size() >= kMostKinds && !kinds_.contains(text)) return;
    Like& like = kinds_[std::move(text)];
    if (like.count++ == 0) return sink_.Warn(like.first = message);
    like.last = message;
    if (like.names.size() < kNamed && !names.empty()) like.names.push_back(std::move(names));
  }

 private:
  static constexpr size_t kNamed = 8;  ///< names in the sentence about the others

  /// Warnings of a kind.
  struct Like {
    std::string first, last;
    std::vector<std::string> names;  ///< of the others, the first few
    size_t count = 0;
  };
  struct Kind {
    std::string text;   ///< the message without quoted names and digits
    std::string names;  ///< the quoted names in it
  };

  static Kind KindOf(const std::string& message) {
    Kind kind;
    bool quoted = false;
    for (const char c : message) {
      if (c == '"') {
        quoted = !quoted;
        if (quoted && !kind.names.empty()) kind.names += ' ';
        if (quoted) kind.text += '"';
      } else if (quoted) {
        kind.names += c;
      } else if (c < '0' || c > '9') {
        kind.text += c;
      }
    }
    return kind;
  }

  void GiveOthers(const Like& like) {
    const size_t others = like.count - 1;
    if (others == 0) return;
    if (others == 1) return sink_.Warn(like.last);
    sink_.Warn(fmt::format("{} more warnings are like \"{}\"{}{}{}", others, like.first,
                           like.names.empty() ? "" : ", of ", fmt::join(like.names, ", "),
                           like.names.empty() || like.names.size() == others ? "" : ", ..."));
  }

  ModelSink& sink_;
  std::set<std::string> warned_;
  std::map<std::string, Like> kinds_;
};

}  // namespace quarry

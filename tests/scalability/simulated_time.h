#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <queue>
#include <utility>
#include <vector>

namespace quarry {

/// A queue of events: the earliest first, events of one time in the order of their making.
class Clock {
 public:
  double now_s() const { return now_s_; }
  void At(double s, std::function<void()> what) { events_.push({s, next_++, std::move(what)}); }
  void Run() {
    while (!events_.empty()) {
      Event event = events_.top();
      events_.pop();
      now_s_ = event.s;
      event.what();
    }
  }

 private:
  struct Event {
    double s;
    uint64_t number;
    std::function<void()> what;
    bool operator<(const Event& other) const { return s != other.s ? s > other.s : number > other.number; }
  };
  std::priority_queue<Event> events_;
  uint64_t next_ = 0;
  double now_s_ = 0;
};

/// A resource that does one task at a time: a link, a processor.
struct Serial {
  double free_s = 0, busy_s = 0;
  /// Reserves the resource for `s` seconds, not before `from`. Returns: the time of the end.
  double Take(double from, double s) {
    busy_s += s;
    return free_s = std::max(free_s, from) + s;
  }
};

}  // namespace quarry

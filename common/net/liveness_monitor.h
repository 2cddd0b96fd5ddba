#pragma once

#include <map>
#include <memory>
#include <vector>

#include "common/net/connection.h"
#include "common/protocol/frame.h"

namespace quarry {

/// When each of the connections that must not fall silent was last heard of: a process that is stopped, or
/// cut off, keeps its connection open. Times are the caller's seconds.
class LivenessMonitor {
 public:
  using ConnectionPtr = std::shared_ptr<Connection>;

  void Add(const ConnectionPtr& c, double now_s) { liveness_[c] = {now_s, 0}; }
  void Forget(const ConnectionPtr& c) { liveness_.erase(c); }

  /// Those not heard of for kSilenceS. To be called often: who has not called for half of that was itself
  /// stopped, and has not listened meanwhile.
  std::vector<ConnectionPtr> Silent(double now_s) {
    const bool slept = now_s - looked_s_ > kSilenceS / 2;
    looked_s_ = now_s;
    std::vector<ConnectionPtr> silent;
    for (auto& [c, pulse] : liveness_) {
      if (slept || c->received_bytes() != pulse.received) pulse = {now_s, c->received_bytes()};
      if (now_s - pulse.heard_s > kSilenceS) silent.push_back(c);
    }
    return silent;
  }

  /// Sends a heartbeat to all of them when the last is kHeartbeatS old.
  void Beat(double now_s) {
    if (now_s - beat_s_ < kHeartbeatS) return;
    beat_s_ = now_s;
    for (const auto& [c, pulse] : liveness_) c->Send({MessageType::kPing, 0, {}, {}});
  }

 private:
  struct Pulse {
    double heard_s = 0;
    uint64_t received = 0;  ///< bytes, then
  };
  std::map<ConnectionPtr, Pulse> liveness_;
  double looked_s_ = 0, beat_s_ = 0;
};

}  // namespace quarry

#pragma once

#include <map>
#include <memory>
#include <vector>

#include "common/net/connection.h"
#include "common/protocol/frame.h"

namespace quarry {

/// Finds connections whose peer has fallen silent. A stopped or cut-off process keeps its connection open, so
/// silence is the only sign.
/// Units: times in seconds of the caller's clock. Not thread-safe.
class LivenessMonitor {
 public:
  using ConnectionPtr = std::shared_ptr<Connection>;

  /// Starts to watch a connection; it counts as heard now.
  void Add(const ConnectionPtr& c, double now_s) { liveness_[c] = {now_s, 0}; }
  void Forget(const ConnectionPtr& c) { liveness_.erase(c); }

  /// The connections silent for more than kSilenceS.
  /// Requires: frequent calls. A gap of more than kSilenceS / 2 means that this process itself was stopped
  /// and could not listen: all silences then start anew.
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

  /// Sends a heartbeat to all connections when the last was sent at least kHeartbeatS ago.
  void Beat(double now_s) {
    if (now_s - beat_s_ < kHeartbeatS) return;
    beat_s_ = now_s;
    for (const auto& [c, pulse] : liveness_) c->Send({MessageType::kPing, 0, {}, {}});
  }

 private:
  struct Pulse {
    double heard_s = 0;
    uint64_t received = 0;  ///< bytes received at heard_s
  };
  std::map<ConnectionPtr, Pulse> liveness_;
  double looked_s_ = 0, beat_s_ = 0;
};

}  // namespace quarry

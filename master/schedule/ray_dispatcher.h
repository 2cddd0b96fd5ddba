#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <set>

#include "common/protocol/messages.h"
#include "master/schedule/leases.h"

namespace quarry {

/// Gives single rays to workers, each to the one that has fewest. A ray goes to another worker too when its
/// holder is late, and to another one instead when its holder is gone. No socket, no clock, no thread. Units:
/// seconds of any clock that does not go back. Not thread-safe.
class RayDispatcher {
 public:
  /// Sends an order to a worker. Called within Assign(); must not call back.
  using Send = std::function<void(uint32_t worker, const RayOrder&)>;
  using OnHit = std::function<void(const RayDone&)>;

  explicit RayDispatcher(Send send) : send_(std::move(send)) {}

  void AddWorker(uint32_t id) { workers_.insert(id); }
  /// A worker that is not here is ignored.
  void RemoveWorker(uint32_t id);

  /// Asks for a ray's nearest hit among the view's parts, within its section. Without a worker the ray waits
  /// for one. `on_hit` is called once, within Finish(), unless Forget() comes before. Returns the ray's
  /// number. Requires: CheckRay().
  uint32_t Ask(const RayQuery& ray, const View& view, OnHit on_hit);
  /// Gives a ray up. One that is not here is ignored.
  void Forget(uint32_t ray);

  /// Sends rays that no worker has, and late ones.
  void Assign(double now_s);
  /// A worker's result. One without a lease is ignored.
  void Finish(uint32_t worker, const RayDone& done);

 private:
  struct Asked {
    RayOrder order;  ///< but for the lease
    OnHit on_hit;
  };
  void Give(uint32_t ray, double now_s);

  const Send send_;
  std::set<uint32_t> workers_;
  std::map<uint32_t, Asked> rays_;  ///< by number, until they are answered
  Leases leases_;                   ///< of these
  uint32_t next_ray_ = 1;
};

}  // namespace quarry

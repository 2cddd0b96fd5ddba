#pragma once

#include <vector>

#include "master/schedule/live_dispatcher.h"
#include "master/worker_registry.h"

namespace quarry {

/// Sends the orders of a LiveDispatcher to the workers that are connected; a worker that is gone gets none.
/// Not thread-safe.
class LiveOrders final : public LiveDispatcher::Sink {
 public:
  /// `workers` must outlive this.
  explicit LiveOrders(WorkerRegistry& workers) : workers_(workers) {}

  void SetUp(uint32_t worker, FrameId frame, const View& view) override;
  void Order(uint32_t worker, TileOrder order) override;
  void End(uint32_t worker, std::vector<FrameId> frames) override;

 private:
  WorkerRegistry& workers_;
};

}  // namespace quarry

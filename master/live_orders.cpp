#include "master/live_orders.h"

#include <utility>

namespace quarry {

void LiveOrders::SetUp(uint32_t worker, FrameId frame, const View& view) {
  WorkerRecord* w = workers_.FindById(worker);
  if (!w) return;
  w->TellNeedsOf(view);
  w->connection->Send(MakeMessage(MessageType::kFrameSetup, FrameSetup{frame, view, 0}));
}

void LiveOrders::Order(uint32_t worker, TileOrder order) {
  if (const WorkerRecord* w = workers_.FindById(worker))
    w->connection->Send(MakeMessage(MessageType::kTile, order));
}

void LiveOrders::End(uint32_t worker, std::vector<FrameId> frames) {
  if (const WorkerRecord* w = workers_.FindById(worker))
    w->connection->Send(MakeMessage(MessageType::kFramesEnd, FramesEnd{std::move(frames)}));
}

}  // namespace quarry

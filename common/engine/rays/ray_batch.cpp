#include "common/engine/rays/ray_batch.h"

namespace quarry {

void RayBatch::Park(uint32_t packet, uint32_t lane, BlockKey block) {
  parked_[block].push_back(packet * RayPacket::kRays + lane);
  const RayPacket& rays = packets_[packet];
  Parked& parked = newly_parked_[block];
  ++parked.rays;
  parked.octants |= OctantBit(rays.direction[0][lane], rays.direction[1][lane], rays.direction[2][lane]);
  ++counts_.suspended;
}

void RayBatch::Resume(BlockKey block) {
  const auto it = parked_.find(block);
  if (it == parked_.end()) return;
  for (const uint32_t slot : it->second)
    ready_[slot / RayPacket::kRays] |= uint64_t{1} << slot % RayPacket::kRays;
  parked_.erase(it);
}

void RayBatch::Forget(uint32_t packet) {
  for (auto& [block, slots] : parked_)
    std::erase_if(slots, [&](uint32_t slot) { return slot / RayPacket::kRays == packet; });
}

void RayBatch::ForgetAll() {
  parked_.clear();
  newly_parked_.clear();
  std::ranges::fill(ready_, 0);
}

}  // namespace quarry

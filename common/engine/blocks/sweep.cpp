#include "common/engine/blocks/sweep.h"

#include <algorithm>

namespace quarry {

VoxelOrder::VoxelOrder(const Catalog& catalog) {
  for (uint32_t octant = 0; octant < kOctants; ++octant) {
    std::vector<uint32_t>& places = places_[octant];
    places.assign(catalog.voxels.size(), 0);
    if (catalog.top_nodes.empty()) continue;
    uint32_t next = 0;
    std::vector<uint32_t> left{0};  // nodes to visit; the nearest is last
    while (!left.empty()) {
      const KdNode node = catalog.top_nodes[left.back()];
      left.pop_back();
      if (!node.is_leaf()) {
        const uint32_t near_side = octant >> node.axis() & 1;
        left.push_back(node.left() + 1 - near_side);
        left.push_back(node.left() + near_side);
      } else if (node.count() != 0) {
        for (uint32_t v = node.first(); v < catalog.chain_end[node.first()]; ++v) places[v] = next++;
      }
    }
  }
}

uint64_t Sweep::Distance(const Stop& stop) const {
  uint64_t least = UINT64_MAX;
  for (uint32_t octant = 0; octant < kOctants; ++octant) {
    if ((stop.octants >> octant & 1) == 0) continue;
    const uint64_t place = order_.BlockPlace(octant, stop.block);
    uint64_t turn = (octant + kOctants - octant_) % kOctants;
    if (turn == 0 && place < at_) turn = kOctants;
    least = std::min(least, turn << BlockKey::kBits | place);
  }
  return least;
}

void Sweep::Add(const Stop& stop) {
  for (uint32_t octant = 0; octant < kOctants; ++octant)
    if ((stop.octants >> octant & 1) != 0)
      wanted_[octant].emplace(order_.BlockPlace(octant, stop.block), stop.block);
}

void Sweep::Remove(const Stop& stop) {
  for (uint32_t octant = 0; octant < kOctants; ++octant)
    if ((stop.octants >> octant & 1) != 0)
      wanted_[octant].erase({order_.BlockPlace(octant, stop.block), stop.block});
}

void Sweep::MoveTo(const Stop& stop) {
  const uint64_t distance = Distance(stop);
  octant_ = static_cast<uint32_t>((octant_ + (distance >> BlockKey::kBits)) % kOctants);
  at_ = distance & ((uint64_t{1} << BlockKey::kBits) - 1);
}

}  // namespace quarry

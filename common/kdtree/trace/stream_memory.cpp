#include "common/kdtree/trace/stream_memory.h"

#include <cstddef>

#include "common/kdtree/node.h"

namespace quarry {
namespace {

/// The number of lists: one at each level of both trees, and a few for packets' places, octants and leaves.
constexpr uint32_t kLists = 2 * kMostLevels + 8;

}  // namespace

StreamMemory& StreamMemory::OfThread() {
  static thread_local StreamMemory memory;
  return memory;
}

StreamMemory::~StreamMemory() = default;

void StreamMemory::Reserve(uint32_t count) {
  if (count <= count_) return;
  count_ = count;
  const size_t in_lists = size_t{kLists} * (count + kSlack);
  rays = std::make_unique_for_overwrite<StreamRay[]>(count);
  hits = std::make_unique_for_overwrite<StreamHit[]>(count);
  ids = std::make_unique_for_overwrite<uint32_t[]>(in_lists);
  masks = std::make_unique_for_overwrite<uint8_t[]>(in_lists);
}

}  // namespace quarry

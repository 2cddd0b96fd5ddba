#include "common/engine/blocks/spare_pages.h"

#include <algorithm>
#include <utility>

#include "common/base/check.h"

namespace quarry {

void SparePages::Keep(PageBuffer buffer) {
  QUARRY_DCHECK(!buffer.is_unit());
  if (buffer.bytes().empty()) return;
  bytes_ += buffer.mapped();
  buffers_.push_back(std::move(buffer));
  TrimTo(1);
}

/// Lets the oldest buffers go while they are too many and more than `left`.
void SparePages::TrimTo(size_t left) {
  while (bytes_ > most_bytes_ && buffers_.size() > left) {
    bytes_ -= buffers_.front().mapped();
    buffers_.erase(buffers_.begin());
  }
}

std::optional<PageBuffer> SparePages::Take(size_t bytes, size_t most_slack) {
  const size_t wanted = WholeMemoryPages(bytes);
  const auto cost = [&](const PageBuffer& buffer) {
    const size_t has = buffer.mapped();
    const bool mapped_anew = has < wanted || has - wanted > most_slack;
    return std::pair(mapped_anew, has > wanted ? has - wanted : wanted - has);
  };
  const auto nearest = std::ranges::min_element(buffers_, {}, cost);
  if (nearest == buffers_.end()) return {};
  PageBuffer taken = std::move(*nearest);
  buffers_.erase(nearest);
  bytes_ -= taken.mapped();
  if (!taken.Resize(bytes, most_slack)) return {};
  return taken;
}

}  // namespace quarry

#include "common/engine/blocks/spare_pages.h"

#include <algorithm>
#include <utility>

#include "common/base/check.h"

namespace quarry {
namespace {

size_t Apart(size_t a, size_t b) { return a > b ? a - b : b - a; }

}  // namespace

void SparePages::Keep(PageBuffer buffer) {
  QUARRY_DCHECK(!buffer.is_unit());
  if (buffer.bytes().empty()) return;
  bytes_ += WholeMemoryPages(buffer.bytes().size());
  buffers_.push_back(std::move(buffer));
  TrimTo(1);
}

/// Lets the oldest buffers go while they are too many and more than `left`.
void SparePages::TrimTo(size_t left) {
  while (bytes_ > most_bytes_ && buffers_.size() > left) {
    bytes_ -= WholeMemoryPages(buffers_.front().bytes().size());
    buffers_.erase(buffers_.begin());
  }
}

std::optional<PageBuffer> SparePages::Take(size_t bytes) {
  const size_t wanted = WholeMemoryPages(bytes);
  const auto apart = [&](const PageBuffer& buffer) {
    return Apart(WholeMemoryPages(buffer.bytes().size()), wanted);
  };
  const auto nearest = std::ranges::min_element(buffers_, {}, apart);
  if (nearest == buffers_.end()) return {};
  PageBuffer taken = std::move(*nearest);
  buffers_.erase(nearest);
  bytes_ -= WholeMemoryPages(taken.bytes().size());
  if (!taken.Resize(bytes)) return {};
  return taken;
}

}  // namespace quarry

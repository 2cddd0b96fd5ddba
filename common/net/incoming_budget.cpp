#include "common/net/incoming_budget.h"

#include <fmt/format.h>

#include <algorithm>

#include "common/base/size.h"
#include "common/net/stream_connection.h"

namespace quarry {

bool IncomingBudget::Take(AcceptedConnection& connection, uint64_t bytes) {
  const auto own = held_.find(&connection);
  const uint64_t wanted = bytes + (own != held_.end() ? own->second : 0);
  while (used_ + bytes > most_) {
    const auto most = std::max_element(held_.begin(), held_.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    if (most == held_.end() || most->first == &connection || most->second <= wanted) return false;
    auto* other = const_cast<AcceptedConnection*>(most->first);
    GiveBack(*other);
    other->Drop(fmt::format("is dropped: incomplete messages take more than {} together", FormatSize(most_)),
                false);
  }
  held_[&connection] = wanted;
  used_ += bytes;
  return true;
}

void IncomingBudget::GiveBack(const AcceptedConnection& connection) {
  const auto it = held_.find(&connection);
  if (it == held_.end()) return;
  used_ -= it->second;
  held_.erase(it);
}

}  // namespace quarry

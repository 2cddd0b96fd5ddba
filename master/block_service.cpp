#include "master/block_service.h"

#include <fmt/format.h>

#include <utility>

namespace quarry {

Status BlockService::Answer(const std::shared_ptr<Connection>& c, const Message& m) {
  QUARRY_ASSIGN(const BlockRequest request, DecodeBlockRequest(m.table));
  uint32_t& owed = owed_[c.get()];
  if (owed == kMostBlockRequests)
    return Fail(fmt::format("more than {} blocks are asked for at once", kMostBlockRequests));
  ++owed;
  source_.Fetch(request.block, [this, c, id = m.request](Result<Bytes> block) {
    if (const auto it = owed_.find(c.get()); --it->second == 0) owed_.erase(it);
    if (!block) return c->Send(MakeMessage(MessageType::kFailure, Failure{block.error().message}, id));
    bytes_served_ += block->size();
    c->Send({MessageType::kBlock, id, {}, std::move(*block)});
  });
  return {};
}

}  // namespace quarry

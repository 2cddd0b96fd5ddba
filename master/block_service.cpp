#include "master/block_service.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

namespace quarry {

BlockService::Reader& BlockService::ReaderOf(const std::shared_ptr<Connection>& c) {
  const auto found = places_.find(c.get());
  if (found != places_.end()) return *found->second;
  readers_.push_back({c, {}, 0, 0});
  places_[c.get()] = std::prev(readers_.end());
  c->SetOnSent([this] {
    if (waiting_ > 0) Pump();
  });
  return readers_.back();
}

Status BlockService::Answer(const std::shared_ptr<Connection>& c, const Message& m) {
  QUARRY_ASSIGN(const BlockRequest request, DecodeBlockRequest(m.table));
  Reader& reader = ReaderOf(c);
  if (reader.owed == kMostBlockRequests)
    return Fail(fmt::format("it requests more than {} blocks at once", kMostBlockRequests));
  ++reader.owed;
  const std::optional<BlockKey> block = catalog_.BlockOf(request.block);
  const uint64_t bytes = block ? catalog_.block(*block).stored : 0;
  // An answer whose connection has gone is dropped.
  Add(reader, {bytes, [this, c = std::weak_ptr(c), block, number = request.block, id = m.request] {
                 const auto connection = c.lock();
                 if (!connection) return;
                 if (block) return Fetch(connection, *block, id);
                 Reply(connection, id, Fail(fmt::format("there is no block {}", number)));
               }});
  return {};
}

void BlockService::Fetch(const std::shared_ptr<Connection>& c, BlockKey block, uint64_t request) {
  const uint64_t bytes = catalog_.block(block).stored;
  ReaderOf(c).reading += bytes;
  reading_ += bytes;
  source_.Fetch(block, [this, weak = std::weak_ptr(c), request, bytes](Result<Bytes> result) {
    reading_ -= bytes;
    const auto connection = weak.lock();
    const auto place = places_.find(connection.get());
    if (connection && place != places_.end()) {
      place->second->reading -= bytes;
      Reply(connection, request, std::move(result));
    }
    Pump();
  });
}

void BlockService::Reply(const std::shared_ptr<Connection>& c, uint64_t request, Result<Bytes> block) {
  --ReaderOf(c).owed;
  if (!block) return c->Send(MakeMessage(MessageType::kFailure, Failure{block.error().message}, request));
  bytes_served_ += block->size();
  c->Send({MessageType::kBlock, request, {}, std::move(*block)});
}

void BlockService::Send(const std::shared_ptr<Connection>& c, uint64_t bytes, std::function<Message()> make) {
  Add(ReaderOf(c), {bytes, [c = std::weak_ptr(c), make = std::move(make)] {
                      if (const auto connection = c.lock()) connection->Send(make());
                    }});
}

void BlockService::Forget(const std::shared_ptr<Connection>& c) {
  const auto place = places_.find(c.get());
  if (place == places_.end()) return;
  waiting_ -= place->second->items.size();
  readers_.erase(place->second);
  places_.erase(place);
  if (waiting_ > 0) Pump();
}

std::vector<std::shared_ptr<Connection>> BlockService::Stalled() const {
  std::vector<std::shared_ptr<Connection>> stalled;
  if (!full_) return stalled;
  for (const Reader& reader : readers_)
    if (reader.connection->unread_s() > kMostUnreadS) stalled.push_back(reader.connection);
  return stalled;
}

void BlockService::Add(Reader& reader, Item item) {
  reader.items.push_back(std::move(item));
  ++waiting_;
  Pump();
}

uint64_t BlockService::Queued() const {
  uint64_t bytes = 0;
  for (const Reader& reader : readers_) bytes += reader.connection->queued_bytes();
  return bytes;
}

bool BlockService::HasRoom(const Reader& reader) const {
  if (reader.items.empty()) return false;
  const uint64_t used = reader.reading + reader.connection->queued_bytes();
  if (used < kLeastBytesEach) return true;
  return used < std::min(kMostBytesEach, reader.connection->taken_bytes());
}

/// Starts answers while there is room, the connections in turn. An answer larger than the room left makes all
/// later ones wait.
void BlockService::Pump() {
  if (std::exchange(pumping_, true)) return;  // answers may come at once
  uint64_t used = reading_ + Queued();
  full_ = false;
  while (waiting_ > 0) {
    auto next = readers_.begin();
    while (next != readers_.end() && !HasRoom(*next)) ++next;
    if (next == readers_.end()) break;
    const uint64_t bytes = next->items.front().bytes;
    full_ = used > 0 && used + bytes > kMostBytes;
    if (full_) break;
    const Item item = std::move(next->items.front());
    next->items.pop_front();
    --waiting_;
    readers_.splice(readers_.end(), readers_, next);
    used += bytes;
    item.start();
  }
  pumping_ = false;
}

}  // namespace quarry

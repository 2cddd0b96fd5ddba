#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <list>
#include <map>
#include <memory>

#include "common/engine/blocks/voxel_source.h"
#include "common/net/connection.h"
#include "common/protocol/messages.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Answers requests for blocks of any number of connections from one source, and sends other large messages.
/// Connections take turns. An answer is read from the source only when there is room: all answers read or
/// queued take kMostBytes together, or one larger answer. A connection's take as much as its peer has read so
/// far, from kLeastBytesEach to kMostBytesEach. Units: bytes, seconds. Not thread-safe: used on the source's
/// thread.
class BlockService {
 public:
  static constexpr uint64_t kMostBytes = 8u << 20, kLeastBytesEach = 64u << 10, kMostBytesEach = 1u << 20;
  /// Seconds without reading after which a connection is dropped while others wait for room.
  static constexpr double kMostUnreadS = 2;

  /// Requires: `source` and `catalog` outlive this.
  BlockService(VoxelSource& source, const Catalog& catalog) : source_(source), catalog_(catalog) {}

  /// Errors: not a request; more than kMostBlockRequests of the connection are open.
  Status Answer(const std::shared_ptr<Connection>& c, const Message& request);
  /// Sends the message that `make` returns when its turn comes. `make` is called then.
  void Send(const std::shared_ptr<Connection>& c, uint64_t bytes, std::function<Message()> make);
  /// The connection has gone.
  void Forget(const std::shared_ptr<Connection>& c);
  /// Connections that hold up others, to be dropped by the caller.
  std::vector<std::shared_ptr<Connection>> Stalled() const;
  uint64_t bytes_served() const { return bytes_served_; }

 private:
  struct Item {
    uint64_t bytes = 0;
    std::function<void()> start;
  };
  /// A connection that waits for answers.
  struct Reader {
    std::shared_ptr<Connection> connection;
    std::deque<Item> items;
    uint32_t owed = 0;     ///< answers to requests
    uint64_t reading = 0;  ///< bytes that the source has been asked for
  };
  Reader& ReaderOf(const std::shared_ptr<Connection>& c);
  void Fetch(const std::shared_ptr<Connection>& c, BlockKey block, uint64_t request);
  void Reply(const std::shared_ptr<Connection>& c, uint64_t request, Result<Bytes> block);
  void Add(Reader& reader, Item item);
  void Pump();
  uint64_t Queued() const;
  bool HasRoom(const Reader& reader) const;

  VoxelSource& source_;
  const Catalog& catalog_;
  std::list<Reader> readers_;  ///< in the order of their turns
  std::map<const Connection*, std::list<Reader>::iterator> places_;
  size_t waiting_ = 0;    ///< items
  uint64_t reading_ = 0;  ///< bytes, over all
  bool pumping_ = false;
  bool full_ = false;  ///< the next answer waits for room
  uint64_t bytes_served_ = 0;
};

}  // namespace quarry

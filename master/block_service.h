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

namespace quarry {

/// Answers requests for blocks, of any number of connections, from one source, and sends what else is large;
/// at most kMostBlockRequests of a connection at a time. Answers are read only when there is room for them:
/// those read or queued, and not yet with the system, take kMostBytes together (or one answer that is
/// larger), of one connection as much as has been taken of what was sent to it, between kLeastBytesEach and
/// kMostBytesEach: who reads nothing gets little. Connections take turns. Used from the source's thread.
class BlockService {
 public:
  static constexpr uint64_t kMostBytes = 8u << 20, kLeastBytesEach = 64u << 10, kMostBytesEach = 1u << 20;
  /// When there is no room, those that have taken nothing for this long are dropped: 2 s.
  static constexpr double kPatienceS = 2;

  /// `size_of`: bytes of a stored block; empty: they are taken for nothing.
  explicit BlockService(VoxelSource& source, std::function<uint64_t(uint32_t)> size_of = {})
      : source_(source), size_of_(std::move(size_of)) {}

  /// Errors: it is no request; the connection has asked for too much at once.
  Status Answer(const std::shared_ptr<Connection>& c, const Message& request);
  /// Sends it when its turn comes. `make` is called then.
  void Send(const std::shared_ptr<Connection>& c, uint64_t bytes, std::function<Message()> make);
  /// The connection has gone.
  void Forget(const std::shared_ptr<Connection>& c);
  /// Those that hold up others; to be dropped.
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
    uint64_t reading = 0;  ///< bytes of those that the source has been asked for
  };
  Reader& ReaderOf(const std::shared_ptr<Connection>& c);
  void Fetch(const std::shared_ptr<Connection>& c, uint32_t block, uint64_t request, uint64_t bytes);
  void Add(Reader& reader, Item item);
  void Pump();
  uint64_t Queued() const;
  bool HasRoom(const Reader& reader) const;

  VoxelSource& source_;
  const std::function<uint64_t(uint32_t)> size_of_;
  std::list<Reader> readers_;  ///< in the order of their turns
  std::map<const Connection*, std::list<Reader>::iterator> places_;
  size_t waiting_ = 0;    ///< items
  uint64_t reading_ = 0;  ///< bytes, over all
  bool pumping_ = false;
  bool full_ = false;  ///< the next answer waits for room
  uint64_t bytes_served_ = 0;
};

}  // namespace quarry

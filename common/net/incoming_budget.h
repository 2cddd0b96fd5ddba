#pragma once

#include <cstdint>
#include <map>

namespace quarry {

class AcceptedConnection;

/// A limit for the memory of half-read messages over all connections of a listener.
/// Units: bytes. Used from the io_context's thread.
class IncomingBudget {
 public:
  explicit IncomingBudget(uint64_t most) : most_(most) {}

  /// Reserves `bytes` more for `connection`. When the limit is reached, the connection that holds most is
  /// dropped, provided it holds more than `connection` would; small messages therefore pass whatever large
  /// ones claim. Returns: false when `connection` itself must be dropped; nothing is reserved then.
  bool Take(AcceptedConnection& connection, uint64_t bytes);
  /// Releases all that `connection` holds.
  void GiveBack(const AcceptedConnection& connection);
  /// Bytes held by all connections together.
  uint64_t used() const { return used_; }

 private:
  uint64_t most_, used_ = 0;
  std::map<const AcceptedConnection*, uint64_t> held_;
};

}  // namespace quarry

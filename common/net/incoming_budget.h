#pragma once

#include <cstdint>
#include <map>

namespace quarry {

class AcceptedConnection;

/// Bytes that half-read messages of a listener's connections may take together. Used from the io_context's
/// thread.
class IncomingBudget {
 public:
  explicit IncomingBudget(uint64_t most) : most_(most) {}

  /// Takes so many bytes more for the connection, where need be by dropping others: whoever holds most goes
  /// first, so that small messages come through whatever large ones claim. False: the connection itself is
  /// to go, and is given nothing.
  bool Take(AcceptedConnection& connection, uint64_t bytes);
  /// Gives back all that the connection holds.
  void GiveBack(const AcceptedConnection& connection);
  uint64_t used() const { return used_; }

 private:
  uint64_t most_, used_ = 0;
  std::map<const AcceptedConnection*, uint64_t> held_;
};

}  // namespace quarry

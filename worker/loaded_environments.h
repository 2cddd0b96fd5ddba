#pragma once

#include <memory>
#include <vector>

#include "common/base/status.h"
#include "common/engine/renderer.h"
#include "common/protocol/messages.h"
#include "worker/block_supply.h"

namespace quarry {

/// The environments that a master has sent, and the supplies of their pages. They stay until the end of the
/// worker. Not thread-safe.
class LoadedEnvironments {
 public:
  /// Takes an Environment message, unless it is here. Its pages come from the master alone, and wait in no
  /// cache of stored blocks. `scene`: how the scene's blocks are supplied. Requires: this outlives the
  /// renderer. Errors: not well formed; a scene; as Renderer::AddEnvironment().
  Status Take(const Message& message, boost::asio::io_context& io, SupplyOptions scene, Renderer& renderer);
  bool Has(const SceneId& id) const;

 private:
  struct Loaded {
    Catalog catalog;
    CacheInventory inventory;
    std::unique_ptr<BlockSupply> supply;
  };
  std::vector<std::unique_ptr<Loaded>> loaded_;
};

}  // namespace quarry

#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/base/status.h"
#include "common/engine/scene.h"
#include "common/remote/http_options.h"
#include "common/scene/view.h"
#include "common/voxel/environment/sky_table.h"
#include "master/block_service.h"

namespace boost::asio {
class io_context;
}

namespace quarry {

/// The environments that a master serves beside its scene, by the names of their images. Used from the
/// io_context's thread.
class Environments {
 public:
  /// A store, and what workers need of it.
  struct Served {
    std::string name;   ///< of the image, without its folder and suffix
    std::string place;  ///< of the store, for commands
    Scene store;
    std::unique_ptr<VoxelSource> source;
    std::unique_ptr<BlockService> blocks;
    Bytes packed_catalog;
  };

  /// Opens stores before a server is made. Errors: as OpenStore(); (usage) a store is a scene's; two have one
  /// name; too many.
  static Result<std::vector<Scene>> Open(const std::vector<std::string>& places, const HttpOptions& http);
  /// `io` must outlive this.
  Environments(boost::asio::io_context& io, const std::vector<Scene>& stores);

  const std::vector<Served>& all() const { return all_; }
  /// Decoded bytes of the largest.
  uint64_t largest_bytes() const;
  /// Null: there is none of this id.
  const Served* Find(const SceneId& id) const;
  /// Whether a connection's Hello asks for the blocks of an environment; then ServiceOf() is its service
  /// until Forget().
  bool Greet(const std::shared_ptr<Connection>& c, const SceneId& store);
  /// Null: the connection has asked for no environment.
  BlockService* ServiceOf(const std::shared_ptr<Connection>& c) const;
  void Forget(const std::shared_ptr<Connection>& c);
  /// As BlockService::Stalled(), of all.
  std::vector<std::shared_ptr<Connection>> Stalled() const;

  /// Finds the environment that a view names and sets its id. A view without one stays as it is. Errors: the
  /// master has no such environment; the sentence names those that it has.
  Status Complete(View& view) const;
  /// The table of the view's environment, or null. Requires: Complete().
  const SkyTable* TableOf(const View& view) const;

 private:
  std::vector<Served> all_;
  std::map<const Connection*, BlockService*> greeted_;
};

}  // namespace quarry

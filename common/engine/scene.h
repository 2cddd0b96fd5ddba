#pragma once

#include <memory>
#include <string>

#include "common/engine/blocks/task_queue.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// A scene to be rendered in this process, from a store that it can read. A value: copies share the store.
/// Thread-safe.
class Scene {
 public:
  /// Errors: as StoreReader::Open's.
  static Result<Scene> Open(const std::string& path);
  explicit Scene(std::shared_ptr<const StoreReader> store) : store_(std::move(store)) {}

  const StoreReader& store() const { return *store_; }
  const Catalog& catalog() const { return store_->catalog(); }
  /// The scene's blocks for one loader, whose thread `executor` posts to.
  std::unique_ptr<VoxelSource> MakeSource(Executor executor) const;

 private:
  std::shared_ptr<const StoreReader> store_;
};

}  // namespace quarry

#pragma once

#include <functional>
#include <memory>
#include <string>

#include "common/engine/blocks/task_queue.h"
#include "common/engine/blocks/voxel_source.h"
#include "common/voxel/store_reader.h"

namespace quarry {

/// A scene from a store that this process can read. Copies share the store. Thread-safe.
class Scene {
 public:
  /// Opens the store at `path`. Errors: as StoreReader::Open().
  static Result<Scene> Open(const std::string& path);
  explicit Scene(std::shared_ptr<const StoreReader> store) : store_(std::move(store)) {}

  const StoreReader& store() const { return *store_; }
  const Catalog& catalog() const { return store_->catalog(); }
  /// A source of the scene's blocks for one loader. `executor` posts to the loader's thread. `on_no_memory`:
  /// see FileVoxelSource.
  std::unique_ptr<VoxelSource> MakeSource(Executor executor, std::function<void()> on_no_memory = {}) const;

 private:
  std::shared_ptr<const StoreReader> store_;
};

}  // namespace quarry

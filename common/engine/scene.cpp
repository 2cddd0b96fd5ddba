#include "common/engine/scene.h"

#include "common/engine/blocks/file_source.h"

namespace quarry {

Result<Scene> Scene::Open(const std::string& path) {
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
  return Scene(std::make_shared<const StoreReader>(std::move(store)));
}

std::unique_ptr<VoxelSource> Scene::MakeSource(Executor executor) const {
  return std::make_unique<FileVoxelSource>(std::move(executor), store_);
}

}  // namespace quarry

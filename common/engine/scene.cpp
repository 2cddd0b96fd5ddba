#include "common/engine/scene.h"

#include <utility>

#include "common/engine/blocks/file_source.h"

namespace quarry {

Result<Scene> Scene::Open(const std::string& path) {
  QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
  return Scene(std::make_shared<const StoreReader>(std::move(store)));
}

std::unique_ptr<VoxelSource> Scene::MakeSource(Executor executor, std::function<void()> on_no_memory) const {
  return std::make_unique<FileVoxelSource>(std::move(executor), store_, std::move(on_no_memory));
}

}  // namespace quarry

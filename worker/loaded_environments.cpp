#include "worker/loaded_environments.h"

#include <algorithm>
#include <utility>

namespace quarry {

Status LoadedEnvironments::Take(const Message& message, boost::asio::io_context& io, SupplyOptions scene,
                                Renderer& renderer) {
  QUARRY_ASSIGN(const EnvironmentSetup setup, DecodeEnvironment(message.table));
  if (Has(setup.id)) return {};
  auto loaded = std::make_unique<Loaded>();
  QUARRY_ASSIGN(const auto sections, UnpackSections(message.raw));
  QUARRY_ASSIGN(loaded->catalog, DecodeCatalog(setup.id, sections));
  if (!loaded->catalog.sky) return Fail("the master sent a scene in the place of an environment");
  scene.sources = {"master"};
  scene.own_sources = false;
  scene.stored_bytes = 0;
  QUARRY_ASSIGN(loaded->supply, BlockSupply::Open(io, loaded->catalog, scene, loaded->inventory));
  QUARRY_TRY(renderer.AddEnvironment(loaded->catalog, loaded->supply->source()));
  loaded_.push_back(std::move(loaded));
  return {};
}

bool LoadedEnvironments::Has(const SceneId& id) const {
  return std::ranges::any_of(loaded_, [&](const auto& known) { return known->catalog.id == id; });
}

}  // namespace quarry

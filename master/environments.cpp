#include "master/environments.h"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <filesystem>
#include <set>
#include <utility>

#include "common/engine/blocks/block_slots.h"
#include "common/remote/open_store.h"

namespace quarry {
namespace {

/// The name of the image that a store was made of, without its suffix; else that of the store.
std::string NameOf(const StoreReader& store) {
  const std::string& path = store.path();
  const std::string file =
      store.models().names.empty() ? path.substr(0, path.find('?')) : store.models().names[0];
  return std::filesystem::path(file).stem().string();
}

/// As a command can name it from any folder. Cuts off the text behind "?" in an address: it may be a
/// signature.
std::string PlaceForPeople(const std::string& path) {
  if (IsRemote(path)) return path.substr(0, path.find('?'));
  std::error_code error;
  const auto absolute = std::filesystem::absolute(path, error).lexically_normal();
  return error ? path : absolute.string();
}

}  // namespace

Result<std::vector<Scene>> Environments::Open(const std::vector<std::string>& places,
                                              const HttpOptions& http) {
  if (places.size() > BlockSlots::kMostEnvironments)
    return BadUsage(fmt::format("--environment: more than {}", BlockSlots::kMostEnvironments));
  std::vector<Scene> stores;
  std::set<std::string> names;
  for (const std::string& place : places) {
    QUARRY_ASSIGN(StoreReader store, OpenStore(place, http));
    if (!store.catalog().sky)
      return BadUsage(fmt::format("--environment {}: is a scene's store, not that of an image", place));
    if (!names.insert(NameOf(store)).second)
      return BadUsage(fmt::format("--environment {}: another environment has this name", place));
    stores.emplace_back(std::make_shared<const StoreReader>(std::move(store)));
  }
  return stores;
}

Environments::Environments(boost::asio::io_context& io, const std::vector<Scene>& stores) {
  for (const Scene& store : stores) {
    auto source =
        store.MakeSource([&io](std::function<void()> task) { boost::asio::post(io, std::move(task)); });
    auto blocks = std::make_unique<BlockService>(*source, store.catalog());
    all_.push_back({NameOf(store.store()), PlaceForPeople(store.store().path()), store, std::move(source),
                    std::move(blocks), PackSections(store.store().catalog_sections())});
  }
}

uint64_t Environments::largest_bytes() const {
  uint64_t largest = 0;
  for (const Served& served : all_) largest = std::max(largest, served.store.catalog().DecodedBytes());
  return largest;
}

const Environments::Served* Environments::Find(const SceneId& id) const {
  const auto found = std::ranges::find(all_, id, [](const Served& s) { return s.store.catalog().id; });
  return found == all_.end() ? nullptr : &*found;
}

bool Environments::Greet(const std::shared_ptr<Connection>& c, const SceneId& store) {
  const Served* const served = Find(store);
  if (served) greeted_[c.get()] = served->blocks.get();
  return served != nullptr;
}

BlockService* Environments::ServiceOf(const std::shared_ptr<Connection>& c) const {
  const auto found = greeted_.find(c.get());
  return found == greeted_.end() ? nullptr : found->second;
}

void Environments::Forget(const std::shared_ptr<Connection>& c) {
  if (BlockService* const service = ServiceOf(c)) service->Forget(c);
  greeted_.erase(c.get());
}

std::vector<std::shared_ptr<Connection>> Environments::Stalled() const {
  std::vector<std::shared_ptr<Connection>> stalled;
  for (const Served& served : all_)
    for (auto& c : served.blocks->Stalled()) stalled.push_back(std::move(c));
  return stalled;
}

Status Environments::Complete(View& view) const {
  ViewEnvironment& wanted = view.environment;
  if (!wanted.is_named() || (wanted.shines() && Find(wanted.id))) return {};
  const auto is_named_so = [&](const Served& s) { return s.name == wanted.name || s.place == wanted.name; };
  const auto found = wanted.shines() ? all_.end() : std::ranges::find_if(all_, is_named_so);
  if (found != all_.end()) {
    wanted.id = found->store.catalog().id;
    return {};
  }
  std::string names;
  for (const Served& served : all_) names += fmt::format("{}'{}'", names.empty() ? "" : ", ", served.name);
  return BadUsage(fmt::format("the master has no environment '{}'{}", wanted.name,
                              names.empty() ? "; it was started without --environment" : ", but " + names));
}

const SkyTable* Environments::TableOf(const View& view) const {
  const Served* const served = view.environment.shines() ? Find(view.environment.id) : nullptr;
  return served ? served->store.catalog().sky.get() : nullptr;
}

}  // namespace quarry

#include "common/api/open_scenes.h"

#include <atomic>
#include <utility>

namespace quarry::api {
namespace {

// Numbers of handles: none is NULL, and as pointers they are aligned.
constexpr uintptr_t kStep = 16;
// Never destroyed: at the end of a process, or in a child, other threads may still be in a call.
std::atomic<OpenScenes*> present{nullptr};

uintptr_t NumberOf(quarry_scene* handle) { return reinterpret_cast<uintptr_t>(handle); }

}  // namespace

OpenScenes& OpenScenes::OfThisProcess() {
  for (OpenScenes* known = present;;) {
    if (known && known->process_ == ::getpid()) return *known;
    auto* mine = new OpenScenes(known ? known->next_.load() : kStep);
    if (present.compare_exchange_strong(known, mine)) return *mine;
    delete mine;
  }
}

quarry_scene* OpenScenes::Add(std::shared_ptr<OpenScene> scene) {
  const std::lock_guard lock(mutex_);
  const uintptr_t number = next_;
  scenes_.emplace(number, std::move(scene));
  next_ += kStep;
  return reinterpret_cast<quarry_scene*>(number);
}

OpenScenes::Known OpenScenes::StateOf(uintptr_t number) const {
  return number != 0 && number < first_ ? Known::kOfParent : Known::kNotOpen;
}

OpenScenes::Found OpenScenes::Find(quarry_scene* handle) {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(NumberOf(handle));
  if (found == scenes_.end()) return {StateOf(NumberOf(handle)), nullptr};
  return {Known::kOpen, found->second};
}

OpenScenes::Found OpenScenes::Take(quarry_scene* handle) {
  const std::lock_guard lock(mutex_);
  const auto found = scenes_.find(NumberOf(handle));
  if (found == scenes_.end()) return {StateOf(NumberOf(handle)), nullptr};
  Found taken{Known::kOpen, std::move(found->second)};
  scenes_.erase(found);
  return taken;
}

}  // namespace quarry::api

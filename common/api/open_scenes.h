#pragma once

#include <unistd.h>

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>

#include "common/api/open_scene.h"

namespace quarry::api {

/// The scenes that this process has open, by handle. Handles are numbers, never given twice, so that a stale
/// one is noticed. Thread-safe.
class OpenScenes {
 public:
  enum class Known { kOpen, kNotOpen, kOfParent };
  struct Found {
    Known known;
    std::shared_ptr<OpenScene> scene;  ///< of kOpen
  };

  /// The scenes of the calling process. After fork() the child has none, and touches nothing of its parent's:
  /// threads that the child lacks may hold locks there.
  static OpenScenes& OfThisProcess();
  quarry_scene* Add(std::shared_ptr<OpenScene> scene);
  Found Find(quarry_scene* handle);
  /// The same, and forgets the scene.
  Found Take(quarry_scene* handle);

 private:
  explicit OpenScenes(uintptr_t first) : first_(first), next_(first) {}
  Known StateOf(uintptr_t number) const;

  const pid_t process_ = ::getpid();
  const uintptr_t first_;  ///< the parent's handles are below
  std::mutex mutex_;       ///< guards all below
  std::atomic<uintptr_t> next_;
  std::map<uintptr_t, std::shared_ptr<OpenScene>> scenes_;
};

}  // namespace quarry::api

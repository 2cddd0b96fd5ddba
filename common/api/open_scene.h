#pragma once

#include <condition_variable>
#include <list>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>

#include "common/api/quarry.h"
#include "common/engine/renderer.h"
#include "common/remote/http_options.h"

namespace quarry::api {

/// A scene that a program has opened: its store, and a renderer, which is made anew after it has failed.
/// Thread-safe.
class OpenScene {
 public:
  /// Errors: OpenStore(); (usage) the cache is smaller than the largest block, or too many threads; no
  /// memory.
  static Result<std::shared_ptr<OpenScene>> Open(const std::string& place, const quarry_options& options,
                                                 const HttpOptions& http = {});

  const StoreReader& store() const { return scene_.store(); }
  const SceneMeta& meta() const { return scene_.catalog().meta; }
  /// Asks all rays of a caller, some at a time: see Renderer::Ask(). `on_rays` gets the numbers of the
  /// caller's rays. Requires: CheckArrays(). Errors: as Renderer::Ask(), and Cancel() or Close()
  /// (kCancelled).
  Status Ask(const quarry_rays& rays, const Renderer::RayAsk& ask, const Renderer::OnRays& on_rays);
  /// Ends the calls under way with this tag, or all.
  void Cancel(uint64_t tag);
  /// Ends all calls, waits for them, and refuses later ones.
  void Close();
  quarry_statistics Measure() const;

 private:
  struct Call {
    uint64_t tag;
    std::stop_source stop;
  };
  OpenScene(StoreReader store, Renderer::Options options);
  Result<std::shared_ptr<Renderer>> TakeRenderer();
  void Drop();

  const Scene scene_;
  const Renderer::Options options_;
  mutable std::mutex mutex_;  ///< guards all below
  std::condition_variable ended_;
  std::list<Call> calls_;
  bool closed_ = false;
  std::shared_ptr<Renderer> renderer_;  ///< the next call replaces one that has failed
  Renderer::Counters before_;           ///< of those replaced
};

}  // namespace quarry::api

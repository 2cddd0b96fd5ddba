#include "common/api/open_scene.h"

#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <utility>

#include "common/api/caller_rays.h"
#include "common/base/resource.h"
#include "common/kdtree/kernels.h"
#include "common/remote/open_store.h"

namespace quarry::api {
namespace {

constexpr uint64_t kDefaultCache = uint64_t{1} << 30;
constexpr uint32_t kMostThreads = 4096;
/// Rays of a call that are queued together. A judgement: their queue takes 2 MB, and threads are out of work
/// for a thousandth of the time at its end.
constexpr size_t kRaysAtOnce = 1u << 24;

/// Threads that are made meanwhile leave signals to the program's own.
class SignalsBlocked {
 public:
  SignalsBlocked() {
    ::sigset_t all;
    ::sigfillset(&all);
    ::pthread_sigmask(SIG_BLOCK, &all, &before_);
  }
  ~SignalsBlocked() { ::pthread_sigmask(SIG_SETMASK, &before_, nullptr); }
  SignalsBlocked(const SignalsBlocked&) = delete;

 private:
  ::sigset_t before_;
};

tl::unexpected<Error> Cancelled(const char* sentence) {
  return tl::unexpected<Error>(Error{sentence, ErrorKind::kCancelled});
}

void Add(Renderer::Counters& to, const Renderer::Counters& more) {
  to.rays += more.rays;
  to.rays_suspended += more.rays_suspended;
  to.compute_us += more.compute_us;
  to.stall_us += more.stall_us;
  to.cache.loaded += more.cache.loaded;
  to.cache.bytes_loaded += more.cache.bytes_loaded;
  to.cache.evictions += more.cache.evictions;
}

}  // namespace

OpenScene::OpenScene(StoreReader store, Renderer::Options options)
    : scene_(std::make_shared<const StoreReader>(std::move(store))), options_(options) {}

Result<std::shared_ptr<OpenScene>> OpenScene::Open(const std::string& place, const quarry_options& options,
                                                   const HttpOptions& http) {
  if (options.threads > kMostThreads)
    return BadUsage(fmt::format("options->threads is {}; at most {}", options.threads, kMostThreads));
  QUARRY_ASSIGN(StoreReader store, OpenStore(place, http));
  QUARRY_TRY(CheckIsScene(store));
  Renderer::Options chosen;
  chosen.cache_bytes = options.cache_bytes == 0 ? kDefaultCache : options.cache_bytes;
  chosen.threads = options.threads == 0 ? UsableProcessors() : options.threads;
  const uint64_t least = store.catalog().meta.largest_decoded;
  if (options.cache_bytes == 0) chosen.cache_bytes = std::max(chosen.cache_bytes, least);
  if (chosen.cache_bytes < least)
    return BadUsage(fmt::format("options->cache_bytes is {}; the scene's largest block needs {}",
                                chosen.cache_bytes, least));
  std::shared_ptr<OpenScene> scene(new OpenScene(std::move(store), chosen));
  const std::lock_guard lock(scene->mutex_);
  QUARRY_TRY(scene->TakeRenderer());
  return scene;
}

/// Requires: mutex_ is held, or nobody else has the scene.
Result<std::shared_ptr<Renderer>> OpenScene::TakeRenderer() {
  if (renderer_ && renderer_->counters().failed) Drop();  // in a call that had ended, or in another's
  if (!renderer_) {
    const SignalsBlocked blocked;
    QUARRY_ASSIGN(renderer_, Renderer::Create(scene_, options_));
  }
  return renderer_;
}

/// Lets a failed renderer go; calls under way may still hold it. Requires: mutex_ is held.
void OpenScene::Drop() {
  Add(before_, renderer_->counters());
  renderer_.reset();
}

Status OpenScene::Ask(const quarry_rays& rays, const Renderer::RayAsk& ask, const Renderer::OnRays& on_rays) {
  std::list<Call> own(1, Call{rays.tag, {}});
  const auto call = own.begin();
  std::shared_ptr<Renderer> renderer;
  {
    const std::lock_guard lock(mutex_);
    if (closed_) return Cancelled("the scene was closed");
    QUARRY_ASSIGN(renderer, TakeRenderer());
    calls_.splice(calls_.begin(), own);
  }
  Status outcome;
  for (size_t base = 0; base < rays.count && outcome; base += kRaysAtOnce) {
    const size_t count = std::min(kRaysAtOnce, rays.count - base);
    Renderer::RayAsk of_these = ask;
    if (!ask.splits.empty()) of_these.splits = ask.splits.subspan(base, count + 1);
    const auto shifted = [&](size_t first, const RenderedTile& of_rays) { on_rays(base + first, of_rays); };
    try {
      outcome =
          renderer->Ask(CallerRays(rays, meta(), base), count, of_these, shifted, call->stop.get_token());
    } catch (const std::bad_alloc&) {
      outcome = tl::unexpected<Error>(Error{{}, ErrorKind::kMemory});
    }
  }
  renderer.reset();
  const std::lock_guard lock(mutex_);
  own.splice(own.begin(), calls_, call);
  ended_.notify_all();
  if (!outcome && outcome.error().kind == ErrorKind::kCancelled)
    return Cancelled(closed_ ? "the scene was closed during the call" : "the call was cancelled");
  return outcome;
}

void OpenScene::Cancel(uint64_t tag) {
  const std::lock_guard lock(mutex_);
  for (Call& call : calls_)
    if (tag == QUARRY_EVERY_TAG || call.tag == tag) call.stop.request_stop();
}

void OpenScene::Close() {
  std::shared_ptr<Renderer> last;
  std::unique_lock lock(mutex_);
  closed_ = true;
  for (Call& call : calls_) call.stop.request_stop();
  ended_.wait(lock, [this] { return calls_.empty(); });
  last = std::move(renderer_);
}

quarry_statistics OpenScene::Measure() const {
  Renderer::Counters all;
  {
    const std::lock_guard lock(mutex_);
    all = before_;
    if (renderer_) {
      const Renderer::Counters now = renderer_->counters();
      Add(all, now);
      all.cache.bytes = now.cache.bytes;
    }
  }
  quarry_statistics s = QUARRY_STATISTICS_INIT;
  s.rays = all.rays;
  s.rays_suspended = all.rays_suspended;
  s.blocks_loaded = all.cache.loaded;
  s.evictions = all.cache.evictions;
  s.bytes_decoded = all.cache.bytes_loaded;
  s.cache_bytes = all.cache.bytes;
  s.compute_seconds = static_cast<double>(all.compute_us) * 1e-6;
  s.stall_seconds = static_cast<double>(all.stall_us) * 1e-6;
  return s;
}

}  // namespace quarry::api

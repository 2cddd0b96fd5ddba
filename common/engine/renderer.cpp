#include "common/engine/renderer.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <mutex>
#include <new>
#include <shared_mutex>
#include <thread>
#include <utility>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/engine/engine.h"
#include "common/engine/integrators/hits.h"
#include "common/kdtree/kernels.h"

namespace quarry {
std::vector<Tile> TilesOf(const PixelRect& pixels, uint32_t step) {
  std::vector<Tile> tiles;
  const uint32_t side = kTileSize * step;
  for (uint32_t y = 0; y < pixels.height; y += side)
    for (uint32_t x = 0; x < pixels.width; x += side)
      tiles.push_back(
          {{pixels.x + x, pixels.y + y, std::min(side, pixels.width - x), std::min(side, pixels.height - y)},
           step});
  return tiles;
}

Status Renderer::Check(const Catalog& catalog, const Options& options) {
  if (options.cache_bytes < catalog.meta.largest_decoded)
    return BadUsage(
        fmt::format("--cache of {} is less than the scene's largest block, {} bytes; give at least that",
                    FormatSize(options.cache_bytes), catalog.meta.largest_decoded));
  if (Kernels().empty()) return BadUsage("QUARRY_ISA names no instruction set that this processor has");
  return {};
}

Renderer::Renderer(const Catalog& catalog, const Options& options, Hooks hooks)
    : catalog_(catalog),
      hooks_(std::move(hooks)),
      cache_(
          catalog, options.cache_bytes, [this] { ScheduleLoader(); }, [this] { ScheduleLoader(); },
          hooks_.on_block) {}

Result<std::unique_ptr<Renderer>> Renderer::Create(const Catalog& catalog, VoxelSource& source,
                                                   Executor executor, const Options& options, Hooks hooks) {
  QUARRY_TRY(Check(catalog, options));
  return WithinLimits([&]() -> Result<std::unique_ptr<Renderer>> {
    std::unique_ptr<Renderer> renderer(new Renderer(catalog, options, std::move(hooks)));
    renderer->Begin(source, std::move(executor), options);
    return renderer;
  });
}

Result<std::unique_ptr<Renderer>> Renderer::Create(const Scene& scene, const Options& options) {
  QUARRY_TRY(Check(scene.catalog(), options));
  return WithinLimits([&]() -> Result<std::unique_ptr<Renderer>> {
    std::unique_ptr<Renderer> renderer(new Renderer(scene.catalog(), options, {}));
    Renderer& r = *renderer;
    r.scene_ = scene;
    r.loader_thread_ = std::thread([&r] { r.tasks_.Run(); });
    const auto executor = [&r](std::function<void()> task) { r.tasks_.Post(std::move(task)); };
    r.source_ = scene.MakeSource(executor, [&r] { r.NoMemory(); });
    r.Begin(*r.source_, executor, options);
    return renderer;
  });
}

void Renderer::Begin(VoxelSource& source, Executor executor, const Options& options) {
  executor_ = std::move(executor);
  loader_.emplace(cache_, source, [this](const Error& error) { Failed(error); });
  engine_ = std::make_unique<Engine>(catalog_, cache_, options.threads, [this] {
    NoMemory();
    // A compute thread notifies the loader's thread, which owns the hooks. It waits for the memory that this
    // takes.
    for (bool told = !hooks_.on_error; !told;) {
      try {
        executor_([this] { Failed(Error{kNoMemory, ErrorKind::kMemory}); });
        told = true;
      } catch (const std::bad_alloc&) {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    }
  });
}

/// Ends all calls, on any thread, without an allocation.
void Renderer::NoMemory() {
  const std::lock_guard lock(mutex_);
  no_memory_ = true;
  for (const auto& call : calls_) {
    const std::lock_guard call_lock(call->mutex);
    call->no_memory = true;
    call->changed.notify_all();
  }
}

/// On the loader's thread.
void Renderer::Failed(const Error& error) {
  {
    const std::lock_guard lock(mutex_);
    if (failure_) return;
    failure_ = error;
    for (const auto& call : calls_) call->End(error);
  }
  if (hooks_.on_error) hooks_.on_error(error);
}

Renderer::~Renderer() {
  // The loader first: it delivers blocks to the compute threads' mailboxes.
  tasks_.Stop();
  if (loader_thread_.joinable()) loader_thread_.join();
  source_.reset();  // its threads, too, may report that no memory is left
  engine_.reset();
}

Status Renderer::AddEnvironment(const Catalog& environment, VoxelSource& source) {
  if (cache_.slots().FindEnvironment(environment.id)) return {};
  QUARRY_ASSIGN(const EnvironmentPages pages, cache_.slots().AddEnvironment(environment));
  loader_->SetEnvironment(pages.number, source);
  return {};
}

/// Makes the loader run once, however many calls come before it runs.
void Renderer::ScheduleLoader() {
  if (scheduled_.exchange(true)) return;
  try {
    executor_([this] {
      scheduled_ = false;
      loader_->Run();
      if (hooks_.on_idle) hooks_.on_idle();
    });
  } catch (const std::bad_alloc&) {  // some callers must not throw
    scheduled_ = false;
    NoMemory();
  }
}

namespace {

std::shared_ptr<const Integrator> IntegratorOf(RayGoal goal, bool surfaces, const HitRule& rule) {
  switch (goal) {
    case RayGoal::kAny:
      return std::make_shared<const AnyHits>(rule);
    case RayGoal::kNearest:
      return std::make_shared<const NearestHits>(surfaces, rule);
    case RayGoal::kCount:
    case RayGoal::kAll:
      break;
  }
  return std::make_shared<const AllHits>(surfaces, rule);
}

}  // namespace

Status Renderer::Render(const View& view, std::span<const Tile> tiles, const OnTile& on_tile,
                        std::stop_token stop, std::shared_ptr<const Integrator> integrator) {
  const auto queue = [&](uint64_t number, size_t i, Engine::OnTile done) {
    return engine_->Render(number, tiles[i], std::move(done));
  };
  return Run(view, std::move(integrator), tiles.size(), queue, on_tile, std::move(stop));
}

namespace {

tl::unexpected<Error> NoMemoryError() { return tl::unexpected<Error>(Error{kNoMemory, ErrorKind::kMemory}); }

/// The rays of a caller. Threads that have not heard of a call's end read others once they are taken back.
class LentRays final : public RayArray {
 public:
  explicit LentRays(const RayArray& rays) : rays_(&rays) {}
  void Read(size_t first, std::span<RayQuery> out) const override {
    const std::shared_lock lock(mutex_);
    if (rays_)
      rays_->Read(first, out);
    else
      std::ranges::fill(out, RayQuery{});
  }
  Status Check(size_t first, size_t count) const override { return rays_->Check(first, count); }
  /// Takes the rays back at its end.
  class Loan {
   public:
    explicit Loan(std::shared_ptr<LentRays> rays) : rays_(std::move(rays)) {}
    ~Loan() {
      const std::unique_lock lock(rays_->mutex_);
      rays_->rays_ = nullptr;
    }
    Loan(const Loan&) = delete;

   private:
    const std::shared_ptr<LentRays> rays_;
  };

 private:
  mutable std::shared_mutex mutex_;
  const RayArray* rays_;
};

/// Limit of the known hits of a part of several rays. Trades memory of open parts against packets that are
/// not full. A judgement: 850 KB of hits and surfaces a part.
constexpr uint64_t kMostHitsOfPart = 1u << 14;

/// The first ray of each part, and the end.
std::vector<size_t> PartsOf(size_t count, std::span<const uint64_t> splits) {
  std::vector<size_t> first{0};
  first.reserve(count / kMostRays + 2);
  for (size_t i = 1; i < count; ++i) {
    const bool full = i - first.back() == kMostRays;
    if (full || (!splits.empty() && splits[i + 1] - splits[first.back()] > kMostHitsOfPart))
      first.push_back(i);
  }
  if (count > 0) first.push_back(count);
  return first;
}

}  // namespace

Status Renderer::Ask(const RayArray& rays, size_t count, const RayAsk& ask, const OnRays& on_rays,
                     std::stop_token stop, const View& view) {
  const auto lent = std::make_shared<LentRays>(rays);
  const LentRays::Loan loan(lent);
  const bool surfaces = ask.surfaces && (ask.goal == RayGoal::kAll || ask.goal == RayGoal::kNearest);
  const std::vector<size_t> first = PartsOf(count, ask.splits);
  const auto queue = [&](uint64_t number, size_t i, Engine::OnTile done) -> Status {
    const size_t of_part = first[i + 1] - first[i];
    QUARRY_TRY(rays.Check(first[i], of_part));
    engine_->Trace(number, {lent, first[i], static_cast<uint32_t>(of_part), ask.goal, ask.from_origin},
                   std::move(done));
    return {};
  };
  const OnTile deliver = [&](size_t i, const RenderedTile& result, Progress) { on_rays(first[i], result); };
  return Run(view, IntegratorOf(ask.goal, surfaces, ask.rule), first.size() - 1, queue, deliver,
             std::move(stop));
}

/// Ends a call however Run() is left.
class Renderer::CallEnder {
 public:
  CallEnder(Renderer& renderer, std::shared_ptr<Call> call, uint64_t view)
      : renderer_(renderer), call_(std::move(call)), view_(view) {}
  ~CallEnder() {
    renderer_.engine_->DropViews(view_, view_ + 1);
    const std::lock_guard lock(renderer_.mutex_);
    renderer_.calls_.erase(call_);
  }
  CallEnder(const CallEnder&) = delete;

 private:
  Renderer& renderer_;
  const std::shared_ptr<Call> call_;
  const uint64_t view_;
};

/// Announces a view, queues its parts and waits until all are done.
Status Renderer::Run(const View& view, std::shared_ptr<const Integrator> integrator, size_t parts,
                     const std::function<Status(uint64_t, size_t, std::function<void(RenderedTile)>)>& queue,
                     const OnTile& on_tile, std::stop_token stop) {
  if (view.environment.shines() && !cache_.slots().FindEnvironment(view.environment.id))
    return Fail("the view names an environment that is not known here");
  const auto call = std::make_shared<Call>();
  call->on_tile = &on_tile;
  call->progress.all = static_cast<uint32_t>(parts);
  const std::stop_callback stopped(stop, [&] { call->End({"cancelled", ErrorKind::kCancelled}); });
  uint64_t number = 0;
  {
    const std::lock_guard lock(mutex_);
    if (failure_) return tl::unexpected<Error>(*failure_);
    if (no_memory_) return NoMemoryError();
    number = next_view_++;
    calls_.insert(call);
  }
  const CallEnder ender(*this, call, number);
  try {
    engine_->SetView(number, view, std::move(integrator));
    for (size_t i = 0; i < parts && !stop.stop_requested(); ++i) {
      const auto done = [call, i](RenderedTile result) { call->OnTileDone(i, std::move(result)); };
      if (const Status queued = queue(number, i, done); !queued) {
        call->End(queued.error());
        break;
      }
    }
  } catch (const std::bad_alloc&) {  // the call ends in order: compute threads may hold parts of it
    const std::lock_guard lock(call->mutex);
    call->no_memory = true;
  }
  std::unique_lock lock(call->mutex);
  call->changed.wait(lock, [&] {
    const bool over = call->error || call->no_memory || call->progress.done == call->progress.all;
    return over && !call->delivering;
  });
  call->on_tile = nullptr;
  if (call->error) return tl::unexpected<Error>(std::move(*call->error));
  if (call->no_memory) return NoMemoryError();
  return {};
}

void Renderer::SetView(uint64_t number, const View& view) { engine_->SetView(number, view); }
void Renderer::DropViews(uint64_t first, uint64_t end) { engine_->DropViews(first, end); }
void Renderer::GiveBackQueued() { engine_->GiveBackQueued(); }
bool Renderer::has_open() const { return engine_->has_open(); }

Status Renderer::Order(uint64_t view, const Tile& tile, std::function<void(RenderedTile)> done,
                       Urgency urgency) {
  return engine_->Render(view, tile, std::move(done), urgency);
}

Status Renderer::Order(const RayQuery& ray, const View& view, std::function<void(RenderedTile)> done,
                       Urgency urgency) {
  QUARRY_TRY(CheckRay(ray));
  uint64_t number = 0;
  {
    const std::lock_guard lock(mutex_);
    number = next_view_++;
  }
  engine_->SetView(number, view, std::make_shared<const NearestHits>());
  engine_->Trace(
      number, {std::make_shared<const RayVector>(std::vector<RayQuery>(1, ray)), 0, 1},
      [this, number, done = std::move(done)](RenderedTile result) {
        done(std::move(result));
        engine_->DropViews(number, number + 1);
      },
      urgency);
  return {};
}

Renderer::Counters Renderer::counters() const {
  const Engine::Counters e = engine_->counters();
  const std::lock_guard lock(mutex_);
  return {e.rays,         e.rays_suspended,  e.compute_us,          e.stall_us,
          e.tiles_wanted, cache_.counters(), failure_ || no_memory_};
}

void Renderer::Call::OnTileDone(size_t index, RenderedTile result) {
  std::unique_lock lock(mutex);
  changed.wait(lock, [&] { return !delivering; });
  if (!on_tile || error || no_memory) return;
  delivering = true;
  ++progress.done;
  const Progress now = progress;
  lock.unlock();  // on_tile may cancel the call
  const auto delivered = [&](bool whole) {
    lock.lock();
    delivering = false;
    no_memory |= !whole;
    lock.unlock();
    changed.notify_all();
  };
  try {
    (*on_tile)(index, std::move(result), now);
  } catch (...) {  // for want of memory: Engine::Run() reports it
    delivered(false);
    throw;
  }
  delivered(true);
}

void Renderer::Call::End(const Error& e) {
  const std::lock_guard lock(mutex);
  error = e;
  changed.notify_all();
}

}  // namespace quarry

#include "master/schedule/footprint_probe.h"

#include <algorithm>
#include <utility>

#include "master/pictures/frame_image.h"

namespace quarry {

Result<ProbedFrame> ProbeFrame(Renderer& renderer, const View& view, std::stop_token stop) {
  constexpr uint64_t kSmallPixels = 512 * kTileSize * kTileSize;
  const uint32_t step = uint64_t{view.crop.width} * view.crop.height <= kSmallPixels ? 2 : 4;
  std::vector<Tile> tiles;
  for (const PixelRect& pixels : TilesOf(view)) tiles.push_back({pixels, step});
  View sparse = view;
  sparse.edges = false;
  sparse.spp = 1;
  sparse.aov_mask = 0;
  sparse.bounces = 0;  // light that bounces meets blocks of the whole scene
  sparse.environment = {};
  ProbedFrame frame(tiles.size());
  QUARRY_TRY(renderer.Render(
      sparse, tiles,
      [&](size_t i, RenderedTile result, Renderer::Progress) {
        frame[i].blocks = renderer.catalog().NumbersOf(result.blocks);
        frame[i].depths = std::move(result.depths);
      },
      std::move(stop)));
  return frame;
}

Result<std::unique_ptr<FootprintProbe>> FootprintProbe::Create(const Scene& scene, uint64_t cache_bytes,
                                                               std::function<void()> on_news) {
  QUARRY_ASSIGN(auto renderer, Renderer::Create(scene, {cache_bytes, 1}));
  return std::unique_ptr<FootprintProbe>(new FootprintProbe(std::move(renderer), std::move(on_news)));
}

FootprintProbe::FootprintProbe(std::unique_ptr<Renderer> renderer, std::function<void()> on_news)
    : renderer_(std::move(renderer)), on_news_(std::move(on_news)), thread_([this] { Run(); }) {}

FootprintProbe::~FootprintProbe() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
    stop_current_.request_stop();
  }
  changed_.notify_one();
  thread_.join();
}

void FootprintProbe::Want(std::vector<Wish> wishes) {
  {
    const std::lock_guard lock(mutex_);
    std::vector<Entry> entries;
    for (Wish& wish : wishes) {
      const auto known = std::ranges::find_if(entries_, [&](const Entry& e) { return e.wish.Is(wish); });
      if (known != entries_.end())
        entries.push_back(std::move(*known));
      else
        entries.push_back({std::move(wish), nullptr});
    }
    entries_ = std::move(entries);
    if (std::ranges::none_of(entries_, [&](const Entry& e) { return e.wish.Is(current_); }))
      stop_current_.request_stop();
  }
  changed_.notify_one();
}

std::shared_ptr<const ProbedFrame> FootprintProbe::Find(const std::string& job, size_t index) const {
  const std::lock_guard lock(mutex_);
  for (const Entry& entry : entries_)
    if (entry.wish.job == job && entry.wish.index == index) return entry.frame;
  return nullptr;
}

bool FootprintProbe::IsAtWork(const std::string& job, size_t index) const {
  const std::lock_guard lock(mutex_);
  return std::ranges::any_of(entries_, [&](const Entry& e) {
    return e.wish.job == job && e.wish.index == index && e.frame == nullptr;
  });
}

void FootprintProbe::Run() {
  for (;;) {
    std::stop_token stop;
    {
      std::unique_lock lock(mutex_);
      const auto open = [this] {
        return std::ranges::find_if(entries_, [](const Entry& e) { return e.frame == nullptr; });
      };
      changed_.wait(lock, [&] { return stop_ || open() != entries_.end(); });
      if (stop_) return;
      current_ = open()->wish;
      stop_current_ = {};
      stop = stop_current_.get_token();
    }
    auto probed = ProbeFrame(*renderer_, current_.view, stop);
    // A frame that is wanted again meanwhile is begun anew.
    if (!probed && probed.error().kind == ErrorKind::kCancelled) continue;
    // Empty where the store cannot be read: the block service reports that.
    auto frame = std::make_shared<const ProbedFrame>(std::move(probed).value_or(ProbedFrame{}));
    {
      const std::lock_guard lock(mutex_);
      for (Entry& entry : entries_)
        if (entry.wish.Is(current_)) entry.frame = std::move(frame);
    }
    on_news_();
  }
}

}  // namespace quarry

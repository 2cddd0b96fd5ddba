#include "master/schedule/footprint_probe.h"

#include <algorithm>
#include <utility>

namespace quarry {

FootprintProbe::FootprintProbe(const StoreReader& store, uint64_t cache_bytes, std::function<void()> on_news)
    : rays_(store, cache_bytes), on_news_(std::move(on_news)), thread_([this] { Run(); }) {}

FootprintProbe::~FootprintProbe() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
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
  }
  changed_.notify_one();
}

std::shared_ptr<const CoarseFrame> FootprintProbe::Find(const std::string& job, size_t index) const {
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
    Wish wish;
    {
      std::unique_lock lock(mutex_);
      const auto open = [this] {
        return std::ranges::find_if(entries_, [](const Entry& e) { return e.frame == nullptr; });
      };
      changed_.wait(lock, [&] { return stop_ || open() != entries_.end(); });
      if (stop_) return;
      wish = open()->wish;
    }
    auto frame = std::make_shared<const CoarseFrame>(GoThrough(wish));
    {
      const std::lock_guard lock(mutex_);
      for (Entry& entry : entries_)
        if (entry.wish.Is(wish)) entry.frame = std::move(frame);
    }
    on_news_();
  }
}

bool FootprintProbe::IsWanted(const Wish& wish) const {
  const std::lock_guard lock(mutex_);
  return !stop_ && std::ranges::any_of(entries_, [&](const Entry& e) { return e.wish.Is(wish); });
}

/// Empty where that is of no use any more, or the store cannot be read: whoever serves its blocks says so.
CoarseFrame FootprintProbe::GoThrough(const Wish& wish) {
  CoarseFrame frame;
  for (const Frame::Tile& tile : Frame::TilesOf(wish.one)) {
    if (!IsWanted(wish)) return {};
    auto traced = rays_.Trace(wish.one, tile);
    if (!traced) return {};
    frame.push_back(std::move(*traced));
  }
  return frame;
}

}  // namespace quarry

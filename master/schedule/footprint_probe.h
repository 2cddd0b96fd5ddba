#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "common/engine/renderer.h"
#include "common/scene/view.h"

namespace quarry {

/// The footprint of a tile, seen by a few rays.
struct ProbedTile {
  std::vector<uint32_t> blocks;  ///< numbers, ascending
  std::vector<float> depths;     ///< how far parts of it are from the eye; infinity: a ray hits nothing there
};
using ProbedFrame = std::vector<ProbedTile>;  ///< by tile; empty: not known

/// Renders a view with one ray for each 2x2 pixels (of more than half a million pixels: 4x4).
/// Errors: as Renderer::Render's.
Result<ProbedFrame> ProbeFrame(Renderer& renderer, const View& view, std::stop_token stop = {});

/// Probes frames that are under way or about to be, to see which blocks their tiles touch. It has a renderer
/// of its own, with one compute thread, so that planning never waits for it. Not thread-safe. Source: Wald &
/// Slusallek 2001, section 6.5 proposes coarse rays for the next view.
class FootprintProbe {
 public:
  struct Wish {
    std::string job;  ///< see JobId
    size_t index = 0;
    View view;
    bool Is(const Wish& other) const { return job == other.job && index == other.index; }
  };
  /// `on_news` is called on a thread of the probe's when a frame has been gone through.
  /// Errors: as Renderer::Create's.
  static Result<std::unique_ptr<FootprintProbe>> Create(const Scene& scene, uint64_t cache_bytes,
                                                        std::function<void()> on_news);
  ~FootprintProbe();

  /// The frames to go through, the most urgent first. All others are forgotten.
  void Want(std::vector<Wish> wishes);
  /// Whether it is to be gone through and has not been.
  bool IsAtWork(const std::string& job, size_t index) const;
  /// Null: not gone through yet.
  std::shared_ptr<const ProbedFrame> Find(const std::string& job, size_t index) const;

 private:
  struct Entry {
    Wish wish;
    std::shared_ptr<const ProbedFrame> frame;
  };

  FootprintProbe(std::unique_ptr<Renderer> renderer, std::function<void()> on_news);
  void Run();

  const std::unique_ptr<Renderer> renderer_;
  const std::function<void()> on_news_;
  mutable std::mutex mutex_;  ///< all below
  std::condition_variable changed_;
  std::vector<Entry> entries_;
  Wish current_;
  std::stop_source stop_current_;
  bool stop_ = false;
  std::thread thread_;  ///< last: it uses all of the above
};

}  // namespace quarry

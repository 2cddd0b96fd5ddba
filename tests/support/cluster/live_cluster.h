#pragma once

#include <algorithm>
#include <catch2/catch.hpp>
#include <deque>
#include <map>
#include <memory>
#include <set>
#include <vector>

#include "common/engine/renderer.h"
#include "master/schedule/live_dispatcher.h"

namespace quarry::test {

/// Workers of a live dispatcher that render when the test says so, by one renderer. Checks that each tile's
/// frame was set up and has not ended.
class LiveCluster : public LiveDispatcher::Sink {
 public:
  struct Ordered {
    uint32_t worker;
    TileOrder order;
  };
  struct Finished {
    LiveTile tile;
    Bytes pixels;
  };

  explicit LiveCluster(const Scene& scene) {
    auto made = Renderer::Create(scene, {16u << 20, 1});
    REQUIRE(made.has_value());
    renderer_ = std::move(*made);
  }

  void SetUp(uint32_t worker, FrameId frame, const View& view) override {
    CHECK(known_.insert({worker, frame}).second);
    views_[frame] = view;
  }
  void Order(uint32_t worker, TileOrder order) override {
    CHECK(known_.contains({worker, order.frame}));
    CHECK(order.urgency > Urgency::kJob);
    const auto received = DecodeTileOrder(Encode(order));
    REQUIRE(received.has_value());
    CHECK((received->area.pixels == order.area.pixels && received->area.step == order.area.step));
    CHECK(CheckTile(order.area, views_.at(order.frame)).has_value());
    orders.push_back({worker, std::move(order)});
  }
  void End(uint32_t worker, std::vector<FrameId> frames) override {
    for (const FrameId frame : frames) {
      CHECK(known_.erase({worker, frame}) == 1);
      std::erase_if(orders, [&](const Ordered& o) { return o.worker == worker && o.order.frame == frame; });
      ++ended;
    }
  }

  /// The view of a frame that was set up.
  const View& ViewOf(FrameId frame) const { return views_.at(frame); }

  /// The oldest order, rendered and finished. None: the dispatcher did not want it.
  std::optional<Finished> RunOne(uint64_t compute_us = 200) {
    REQUIRE_FALSE(orders.empty());
    const Ordered next = std::move(orders.front());
    orders.pop_front();
    return Run(next, compute_us);
  }
  /// An order's result.
  TileDone Render(const Ordered& ordered, Bytes& pixels, uint64_t compute_us = 200) {
    const TileOrder& order = ordered.order;
    TileDone answer{order.frame, order.tile, order.lease, 1, 0, compute_us};
    REQUIRE(renderer_
                ->Render(views_.at(order.frame), std::span(&order.area, 1),
                         [&](size_t, RenderedTile result, Renderer::Progress) {
                           pixels = std::move(result.pixels);
                           if (order.area.form == PixelForm::kMeans) answer.depths = std::move(result.depths);
                           holes += result.holes;
                         })
                .has_value());
    REQUIRE(DecodeTileDone(Encode(answer)).has_value());
    return answer;
  }
  std::optional<Finished> Run(const Ordered& ordered, uint64_t compute_us = 200) {
    Finished done;
    const TileDone answer = Render(ordered, done.pixels, compute_us);
    const auto finished = dispatcher.Finish(ordered.worker, answer, done.pixels.size());
    REQUIRE(finished.has_value());
    if (!*finished) return std::nullopt;
    done.tile = **finished;
    return done;
  }
  /// A picture as a batch job renders it: float32 means and coverage.
  std::vector<uint32_t> Batch(const View& view) {
    std::vector<uint32_t> words(kColorWords * size_t{view.width} * view.height);
    const std::vector<Tile> tiles = TilesOf(view.crop);
    REQUIRE(renderer_
                ->Render(view, tiles,
                         [&](size_t i, RenderedTile result, Renderer::Progress) {
                           const PixelRect& p = tiles[i].pixels;
                           for (uint32_t y = 0; y < p.height; ++y)
                             std::memcpy(&words[kColorWords * (size_t{p.y + y} * view.width + p.x)],
                                         result.pixels.data() + size_t{y} * p.width * 4 * kColorWords,
                                         size_t{p.width} * 4 * kColorWords);
                         })
                .has_value());
    return words;
  }

  std::deque<Ordered> orders;
  uint64_t ended = 0, holes = 0;
  LiveDispatcher dispatcher{*this, kFirstLiveFrame};

 private:
  std::unique_ptr<Renderer> renderer_;
  std::set<std::pair<uint32_t, FrameId>> known_;
  std::map<FrameId, View> views_;
};

}  // namespace quarry::test

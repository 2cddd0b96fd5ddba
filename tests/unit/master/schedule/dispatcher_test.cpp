#include "master/schedule/dispatcher.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <deque>
#include <map>
#include <memory>
#include <unordered_map>
#include <vector>

#include "tests/support/rendering/looking.h"

// Frames dispatched to workers that answer late, never, or with lies: the master's dispatcher by a clock that
// the test moves.

namespace quarry {
namespace {

constexpr double kNever = 1e9, kStepS = 0.05;

/// A worker of the test. Units: seconds.
struct Actor : WorkerState {
  Actor(uint32_t number, uint32_t its_threads, double its_tile_s = 0.1) : tile_s(its_tile_s) {
    id = number;
    threads = its_threads;
    ready = true;
  }
  Actor& Claims(uint64_t us) { return claimed_us = us, *this; }

  double tile_s;                ///< computing, on one thread; kNever: it does not answer
  uint64_t claimed_us = 50000;  ///< for each tile
};

/// A walk of equal frames, and its workers.
class Cluster : FrameSource {
 public:
  explicit Cluster(std::vector<Actor> them, uint32_t width = 320, uint32_t height = 256)
      : actors(std::move(them)), view(test::Looking({0, 0, 0}, {0, 10, 0}, width, height)) {
    for (Actor& a : actors) dispatcher.AddWorker(a);
    dispatcher.SetCosts(1e-6, 0);
    dispatcher.PlanForWorkers();
  }

  /// As the master's tick does. True when all frames are done.
  bool Step() {
    now_s += kStepS;
    Answer();
    (void)dispatcher.MuteWorkers();
    for (const AssignedTile& tile : dispatcher.AssignTiles(now_s))
      orders.push_back({tile.worker, tile.order, now_s + Find(tile.worker).tile_s});
    return frames_done == frames;
  }

  /// Steps until the frames are done; the seconds that they took, or kNever.
  double Run(double most_s) {
    while (now_s < most_s)
      if (Step()) return now_s;
    return kNever;
  }

  Actor& Find(uint32_t id) {
    return *std::find_if(actors.begin(), actors.end(), [&](const Actor& a) { return a.id == id; });
  }

  std::vector<Actor> actors;
  View view;
  uint32_t frames = 1, frames_begun = 0, frames_done = 0;
  bool known = false;  ///< each tile is known to touch the block of its number
  Dispatcher dispatcher{*this, std::vector<uint32_t>(4096, 1000), SchedulingPolicy::kFootprint, 1};
  double now_s = 0;

 private:
  bool HasNext() const override { return frames_begun < frames; }
  std::optional<View> Begin(FrameId, double) override {
    if (!HasNext()) return std::nullopt;
    ++frames_begun;
    return view;
  }
  void Probe(std::span<ActiveFrame* const> under_way) override {
    if (!known) return;
    for (ActiveFrame* frame : under_way) {
      if (frame->learned()) continue;
      auto coarse = std::make_shared<ProbedFrame>();
      for (uint32_t t = 0; t < frame->image().tiles().size(); ++t) coarse->push_back({{t}, {10}});
      frame->Learn(std::move(coarse));
    }
  }
  bool IsNextBeingProbed() const override { return false; }
  void Finish(ActiveFrame&, double) override { ++frames_done; }

  void Answer() {
    for (Order& o : orders) {
      if (o.due_s > now_s) continue;
      o.due_s = 2 * kNever;
      Actor& actor = Find(o.worker);
      TileDone done{o.order.frame, o.order.tile, o.order.lease, 0, 0, actor.claimed_us};
      done.depths.assign(
          size_t{DepthCells(o.order.area.pixels.width)} * DepthCells(o.order.area.pixels.height), 10);
      const Bytes pixels(size_t{o.order.area.pixels.width} * o.order.area.pixels.height *
                         WordsPerPixel(view.aov_mask) * 4);
      REQUIRE(dispatcher.Finish(actor, done, pixels, now_s).has_value());
    }
  }

  struct Order {
    uint32_t worker;
    TileOrder order;
    double due_s;
  };
  std::deque<Order> orders;
};

}  // namespace

TEST_CASE("A frame is done though a worker is silent, whether it holds tiles or is to get them") {
  // 80 tiles; the silent worker holds every block, and a block costs the other worker more to fetch than the
  // silent one's open work is worth.
  for (const uint32_t silent_threads : {1u, 30u, 200u}) {
    INFO(silent_threads);
    Cluster cluster({{1, 1}, {2, silent_threads, kNever}});
    cluster.known = true;
    for (uint32_t b = 0; b < 80; ++b) cluster.Find(2).holds.Set(b, true);
    cluster.dispatcher.SetCosts(1, 0);
    // 80 tiles of 0.1 s at the worker that answers, four at a time, and the time until it is clear.
    CHECK(cluster.Run(60) < 12);
    CHECK(cluster.actors[0].tiles == 80);
  }
}

TEST_CASE("Tiles that a worker gives back are given to others, and no other lease ends") {
  Cluster cluster({{1, 1, kNever}, {2, 1, kNever}});
  cluster.Step();
  const ActiveFrame& frame = *cluster.dispatcher.Frames().front();
  const auto held_by = [&](uint32_t worker) {
    std::unordered_map<uint32_t, uint32_t> held;
    frame.AddHeld(held);
    return held[worker];
  };
  const uint32_t first = held_by(1), second = held_by(2);
  REQUIRE((first > 1 && second > 1));
  cluster.Find(1).ready = false;  // it leaves
  for (uint64_t lease = 0; lease < 100; ++lease) {
    cluster.dispatcher.GiveBack(1, frame.id(), lease);
    cluster.dispatcher.GiveBack(1, frame.id() + 7, lease);  // no such frame
  }
  CHECK(held_by(1) == 0);
  CHECK(held_by(2) == second);
  CHECK(frame.counts().leases_lost == 0);
  cluster.dispatcher.RemoveWorker(2);
  cluster.Find(2).tile_s = 0.1;
  cluster.dispatcher.AddWorker(cluster.Find(2));  // it answers now
  cluster.dispatcher.PlanForWorkers();
  CHECK(cluster.Run(60) < 20);
}

TEST_CASE("A worker counts as quiet when it has held tiles for the grace period and answered none") {
  Responsiveness responsiveness;
  responsiveness.Update(0, true);
  responsiveness.Update(Responsiveness::kGraceS, true);
  CHECK(responsiveness.quiet_s() == 0);
  responsiveness.Update(Responsiveness::kGraceS + 3, true);
  CHECK(responsiveness.quiet_s() == 3);
  responsiveness.Answered(true);
  CHECK(responsiveness.quiet_s() == 0);
  responsiveness.Update(Responsiveness::kGraceS + 6, true);
  CHECK(responsiveness.quiet_s() == 0);
}

TEST_CASE("A tile that two silent workers hold is given to a third") {
  Cluster cluster({{1, 1}, {2, 1, kNever}, {3, 1, kNever}}, 64, 64);
  cluster.actors[0].ready = false;  // until both hold all four tiles, or copies of them
  for (double t = 0; t < 4; t += kStepS) REQUIRE_FALSE(cluster.Step());
  cluster.actors[0].ready = true;
  CHECK(cluster.Run(30) < 5);
}

TEST_CASE("Any number of silent workers delays nobody else for long") {
  std::vector<Actor> actors{{1, 2}};
  for (uint32_t id = 2; id < 20; ++id) actors.push_back({id, 8, kNever});
  Cluster cluster(std::move(actors));
  CHECK(cluster.Run(120) < 8);
}

TEST_CASE("A worker whose tiles only others finish is doubtful, then mute; a slow worker is not") {
  Cluster cluster({{1, 1}, {2, 1, kNever}, {3, 1, 3}}, 640, 512);
  double doubtful_s = 0, mute_s = 0;
  while (mute_s == 0 && cluster.now_s < 100 && !cluster.Step()) {
    if (doubtful_s == 0 && cluster.Find(2).responsiveness.doubtful()) doubtful_s = cluster.now_s;
    if (cluster.Find(2).responsiveness.mute()) mute_s = cluster.now_s;
    CHECK_FALSE(cluster.Find(1).responsiveness.mute());
    CHECK_FALSE(cluster.Find(3).responsiveness.mute());
  }
  CHECK(doubtful_s >= Responsiveness::kDoubtfulS);
  CHECK((mute_s == 0 || mute_s >= Responsiveness::kMuteS));
  CHECK(cluster.Find(2).tiles == 0);
}

TEST_CASE(
    "A worker that holds tiles for twenty seconds without an answer is mute, over any number of frames") {
  Responsiveness responsiveness;
  double now_s = 0;
  const auto hold = [&](double s) {
    responsiveness.Update(now_s, true);
    now_s += s;
    responsiveness.Update(now_s, false);
    now_s += 100;  // in which it has nothing to do
  };
  for (int frame = 0; frame < 12; ++frame) {
    CHECK_FALSE(responsiveness.mute());
    hold(1.7);
    responsiveness.Outdone();
  }
  CHECK(responsiveness.mute());
  responsiveness.Answered(false);
  CHECK_FALSE(responsiveness.mute());
  CHECK_FALSE(responsiveness.doubtful());
}

TEST_CASE("A tile that takes every worker long makes none mute") {
  Cluster cluster({{1, 1, 200}, {2, 1, 300}}, 64, 32);
  while (!cluster.Step()) {
    REQUIRE(cluster.now_s < 1000);
    REQUIRE_FALSE(cluster.Find(1).responsiveness.mute());
  }
  CHECK(cluster.Find(1).tiles == 2);
}

TEST_CASE("Forged costs count for no more than the time that a worker has had the tile") {
  Cluster cluster({Actor(1, 1), Actor(2, 1).Claims(~uint64_t{0})});
  cluster.frames = 2;
  while (cluster.frames_done == 0) REQUIRE_FALSE((cluster.Step() || cluster.now_s > 20));
  const ActiveFrame* next = cluster.dispatcher.Frames().at(0);
  std::map<uint32_t, int> planned;
  for (const TileView& tile : next->MakeSnapshot({}, 0).tiles) {
    CHECK(tile.cost_s < 5);
    ++planned[tile.owner];
  }
  CHECK(planned[1] > 10);
  CHECK(planned[2] > 10);
}

TEST_CASE("A silent worker that claims a thousand threads delays nobody") {
  Cluster cluster({{1, 2}, {2, 1024, kNever}}, 640, 512);  // 320 tiles
  CHECK(cluster.Run(200) < 30);
}

}  // namespace quarry

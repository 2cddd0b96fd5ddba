#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <memory>
#include <set>

#include "master/schedule/active_frame.h"
#include "master/schedule/conduct.h"
#include "tests/support/looking.h"

// Frames handed out to workers that answer late, never, or with lies: the master's scheduling without its
// sockets, by a clock that the test moves.

namespace quarry {
namespace {

constexpr double kNever = 1e9, kStepS = 0.05;

struct Actor {
  uint32_t id = 0, threads = 1;
  double tile_s = 0.1;          ///< computing, on one thread; kNever: it does not answer
  double fetch_s = 0;           ///< that the master expects it to fetch for any tile
  uint64_t claimed_us = 50000;  ///< for each tile
  uint32_t credit = 4;
  Conduct conduct;
  uint32_t answered = 0;
};

/// A frame and its workers.
struct Scene {
  explicit Scene(std::vector<Actor> them, uint32_t width = 320, uint32_t height = 256)
      : actors(std::move(them)), frame(1, test::Looking({0, 0, 0}, {0, 10, 0}, width, height), nullptr) {
    Plan();
  }

  void Plan() {
    std::map<uint32_t, double> speeds;
    std::map<uint32_t, BlockSet> holds;
    for (const Actor& a : actors) {
      speeds[a.id] = a.threads;
      holds[a.id] = {};
    }
    ActiveFrame* frames[] = {&frame};
    PlanFrames(frames, nullptr, PlanNews::kWorkers, speeds, holds, {bytes, 1e-6, 0},
               SchedulingPolicy::kFootprint);
  }

  /// As the master's tick does. True when the frame is done.
  bool Step() {
    now_s += kStepS;
    Answer();
    std::unordered_map<uint32_t, uint32_t> held;
    frame.AddHeld(held);
    std::set<uint32_t> outdone;
    frame.AddOutdone(outdone);
    std::vector<WorkerCredit> hands;
    for (Actor& a : actors) {
      a.conduct.Look(now_s, held.contains(a.id));
      if (outdone.contains(a.id)) a.conduct.Outdone();
      hands.push_back({a.id, a.conduct.doubtful() ? 1 : a.credit, a.threads, a.conduct.quiet_s()});
    }
    const auto fetch_s = [&](const ActiveFrame&, uint32_t, uint32_t worker) { return Find(worker).fetch_s; };
    for (const AssignedTile& tile :
         AssignTiles({&frame}, hands, now_s, false, fetch_s, [] { return nullptr; }))
      given.push_back({tile.worker, tile.order, now_s + Find(tile.worker).tile_s});
    return frame.done();
  }

  /// Steps until the frame is done; the seconds that it took, or kNever.
  double Run(double most_s) {
    while (now_s < most_s)
      if (Step()) return now_s;
    return kNever;
  }

  Actor& Find(uint32_t id) {
    return *std::find_if(actors.begin(), actors.end(), [&](const Actor& a) { return a.id == id; });
  }

  void Answer() {
    for (Given& g : given) {
      if (g.due_s > now_s) continue;
      g.due_s = 2 * kNever;
      Actor& actor = Find(g.worker);
      TileDone done{1, g.order.tile, g.order.lease, 0, 0, actor.claimed_us};
      done.depths.assign(size_t{DepthCells(g.order.width)} * DepthCells(g.order.height), 10);
      const Bytes pixels(size_t{g.order.width} * g.order.height * frame.frame().words_per_pixel() * 4);
      const bool kept = *frame.Finish(done, pixels, now_s);
      actor.answered += kept;
      actor.conduct.Answered(kept);
    }
  }

  struct Given {
    uint32_t worker;
    TileOrder order;
    double due_s;
  };
  std::vector<Actor> actors;
  ActiveFrame frame;
  std::vector<uint32_t> bytes = std::vector<uint32_t>(4096, 1000);
  std::vector<Given> given;
  double now_s = 0;
};

}  // namespace

TEST_CASE("A frame is done though a worker answers nothing, whether it holds tiles or is to get them") {
  // 80 tiles; the other's credit lets it take few at a time, and what is planned for the silent one costs
  // more to fetch than that one's open work is worth.
  for (const uint32_t credit : {2u, 30u, 200u}) {
    INFO(credit);
    Scene scene({{1, 1}, {2, 1, kNever, 0, 0, credit}});
    scene.actors[0].fetch_s = 1000;
    const double took_s = scene.Run(60);
    CHECK(took_s <
          12);  // 80 tiles of 0.1 s at the one that answers, four at a time, and a second until it is clear
    CHECK(scene.actors[0].answered == 80);
  }
}

TEST_CASE("A worker counts as quiet once it has held tiles for the time of grace and answered none") {
  Conduct conduct;
  conduct.Look(0, true);
  conduct.Look(Conduct::kGraceS, true);
  CHECK(conduct.quiet_s() == 0);
  conduct.Look(Conduct::kGraceS + 3, true);
  CHECK(conduct.quiet_s() == 3);
  conduct.Answered(true);
  CHECK(conduct.quiet_s() == 0);
  conduct.Look(Conduct::kGraceS + 6, true);
  CHECK(conduct.quiet_s() == 0);
}

TEST_CASE("A tile that two silent workers hold goes to a third") {
  Scene scene({{1, 1}, {2, 1, kNever}, {3, 1, kNever}}, 64, 64);
  scene.actors[0].credit = 0;  // until both hold all four tiles, or copies of them
  for (double t = 0; t < 4; t += kStepS) REQUIRE_FALSE(scene.Step());
  scene.actors[0].credit = 4;
  CHECK(scene.Run(30) < 5);
}

TEST_CASE("Any number of silent workers holds up nobody else for long") {
  std::vector<Actor> actors{{1, 2}};
  for (uint32_t id = 2; id < 20; ++id) actors.push_back({id, 4, kNever, 0, 0, 18});
  Scene scene(std::move(actors));
  CHECK(scene.Run(120) < 8);
}

TEST_CASE("Who holds tiles that others finish, and answers none, is doubtful, then mute; a slow one is not") {
  Scene scene({{1, 1}, {2, 1, kNever}, {3, 1, 3}}, 640, 512);
  double doubtful_s = 0, mute_s = 0;
  while (mute_s == 0 && scene.now_s < 100) {
    scene.Step();
    // The next frame: the same silent worker gets tiles again.
    if (scene.frame.done()) break;
    if (doubtful_s == 0 && scene.Find(2).conduct.doubtful()) doubtful_s = scene.now_s;
    if (scene.Find(2).conduct.mute()) mute_s = scene.now_s;
    CHECK_FALSE(scene.Find(1).conduct.mute());
    CHECK_FALSE(scene.Find(3).conduct.mute());
  }
  CHECK(doubtful_s >= Conduct::kDoubtfulS);
  CHECK((mute_s == 0 || mute_s >= Conduct::kMuteS));
  CHECK(scene.Find(2).answered == 0);
}

TEST_CASE("Mute is who answers nothing for twenty seconds of holding tiles, over any number of frames") {
  Conduct conduct;
  double now_s = 0;
  const auto hold = [&](double s) {
    conduct.Look(now_s, true);
    now_s += s;
    conduct.Look(now_s, false);
    now_s += 100;  // in which it has nothing to do
  };
  for (int frame = 0; frame < 12; ++frame) {
    CHECK_FALSE(conduct.mute());
    hold(1.7);
    conduct.Outdone();
  }
  CHECK(conduct.mute());
  conduct.Answered(false);
  CHECK_FALSE(conduct.mute());
  CHECK_FALSE(conduct.doubtful());
}

TEST_CASE("A tile that takes everybody long makes nobody mute") {
  Scene scene({{1, 1, 200}, {2, 1, 300}}, 64, 32);
  while (!scene.Step()) {
    REQUIRE(scene.now_s < 1000);
    REQUIRE_FALSE(scene.Find(1).conduct.mute());
  }
  CHECK(scene.Find(1).answered == 2);
}

TEST_CASE("Forged costs count for no more than the time that a worker has had the tile") {
  Scene scene({{1, 1}, {2, 1, 0.1, 0, ~uint64_t{0}}});
  REQUIRE(scene.Run(60) < 20);
  ActiveFrame next(2, scene.frame.job(), &scene.frame);
  ActiveFrame* frames[] = {&next};
  PlanFrames(frames, &scene.frame, PlanNews::kFrames, {{1, 1}, {2, 1}}, {{1, {}}, {2, {}}},
             {scene.bytes, 1e-6, 0}, SchedulingPolicy::kFootprint);
  for (const TileView& tile : next.MakeSnapshot({}, 0).tiles) CHECK(tile.cost_s < 5);
  std::map<uint32_t, int> planned;
  for (const TileView& tile : next.MakeSnapshot({}, 0).tiles) ++planned[tile.owner];
  CHECK(planned[1] > 10);
  CHECK(planned[2] > 10);
}

TEST_CASE("Who claims a thousand threads and answers nothing holds up nobody") {
  Scene scene({{1, 2, 0.1, 0.5}, {2, 1024, kNever, 0, 0, 130}}, 640, 512);  // 320 tiles
  CHECK(scene.Run(200) < 30);
}

}  // namespace quarry

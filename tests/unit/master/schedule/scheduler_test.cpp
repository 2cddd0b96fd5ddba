#include "master/schedule/scheduler.h"

#include <algorithm>
#include <catch2/catch.hpp>
#include <map>
#include <set>
#include <unordered_map>
#include <utility>

#include "master/schedule/tile_assignment.h"

namespace quarry {
namespace {

Snapshot MakeSnapshot(size_t tiles, std::vector<WorkerView> workers) {
  Snapshot s;
  s.tiles.resize(tiles);
  s.workers = std::move(workers);
  return s;
}

/// Of a whole tile.
std::vector<float> Depths() {
  return std::vector<float>(size_t{DepthCells(kTileSize)} * DepthCells(kTileSize), 1.0f);
}

std::map<uint32_t, std::set<uint32_t>> ByWorker(const std::vector<Assignment>& assignments) {
  std::map<uint32_t, std::set<uint32_t>> out;
  for (const Assignment& a : assignments) out[a.worker].insert(a.tile);
  return out;
}

}  // namespace

TEST_CASE("Without history each worker gets a stretch of the curve") {
  const auto got = ByWorker(Schedule(MakeSnapshot(8, {{1, 4}, {2, 4}}), Stealing::kYes));
  CHECK(got.at(1) == std::set<uint32_t>{0, 1, 2, 3});
  CHECK(got.at(2) == std::set<uint32_t>{4, 5, 6, 7});
}

TEST_CASE("A worker gets back the tiles it rendered last") {
  Snapshot s = MakeSnapshot(6, {{1, 3}, {2, 3}});
  for (uint32_t t = 0; t < 6; ++t) s.tiles[t].owner = t % 2 ? 1 : 2;
  const auto got = ByWorker(Schedule(s, Stealing::kYes));
  CHECK(got.at(1) == std::set<uint32_t>{1, 3, 5});
  CHECK(got.at(2) == std::set<uint32_t>{0, 2, 4});
}

TEST_CASE("Credit is never exceeded and no tile is given twice") {
  const auto assignments = Schedule(MakeSnapshot(100, {{1, 3}, {2, 0}, {3, 5}}), Stealing::kYes);
  const auto got = ByWorker(assignments);
  CHECK(assignments.size() == 8);
  CHECK(got.at(1).size() == 3);
  CHECK(got.count(2) == 0);
  CHECK(got.at(3).size() == 5);
  for (uint32_t t : got.at(1)) CHECK(got.at(3).count(t) == 0);
}

TEST_CASE("A worker with nothing left takes from the other's end") {
  Snapshot s = MakeSnapshot(10, {{1, 0}, {2, 2}});
  for (auto& tile : s.tiles) tile.owner = 1;
  const auto got = ByWorker(Schedule(s, Stealing::kYes));
  CHECK(got.at(2) == std::set<uint32_t>{8, 9});
  CHECK(Schedule(s, Stealing::kNo).empty());
}

TEST_CASE("It takes from the worker that has most left") {
  Snapshot s = MakeSnapshot(230, {});
  for (uint32_t w = 1; w <= 100; ++w) s.workers.push_back({w, w == 1 ? 2u : 0u});
  for (uint32_t t = 0; t < 230; ++t) {
    s.tiles[t].owner = t < 198 ? 2 + t / 2 : 57;
    s.tiles[t].cost_s = 1;
  }
  CHECK(Schedule(s, Stealing::kYes) == std::vector<Assignment>{{229, 1}, {228, 1}});
}

TEST_CASE("Stragglers are given to an idle worker once, never to their holder") {
  Snapshot s = MakeSnapshot(3, {{1, 5}, {2, 5}});
  s.now_s = 10;
  s.tiles[0].done = true;
  s.tiles[1].held = s.tiles[2].held = true;
  Leases leases;
  s.leases = &leases;
  leases.Give(1, 1, 10 - 4 * s.straggler_after_s);
  leases.Give(2, 1, 10 - s.straggler_after_s / 2);
  CHECK(Schedule(s, Stealing::kYes) == std::vector<Assignment>{{1, 2}});
  leases.Give(1, 2, 10 - 3 * s.straggler_after_s);
  CHECK(Schedule(s, Stealing::kYes).empty());
  CHECK(Schedule(MakeSnapshot(3, {}), Stealing::kYes).empty());
}

TEST_CASE("Tiles held of one frame leave less credit for the next") {
  View view;
  view.width = view.height = 64;
  REQUIRE(NormalizeView(view).has_value());
  ActiveFrame first(1, view, nullptr), second(2, view, &first);
  bool begun = false;
  const auto next = [&] { return std::exchange(begun, true) ? nullptr : &second; };
  const auto count = [](const std::vector<AssignedTile>& tiles, const ActiveFrame& frame) {
    return std::count_if(tiles.begin(), tiles.end(),
                         [&](const AssignedTile& t) { return t.frame == &frame; });
  };
  const auto given = AssignTiles({&first}, {{1, 6}}, 0, false, {}, next);
  CHECK(given.size() == 6);
  CHECK(count(given, first) == 4);
  CHECK(AssignTiles({&first, &second}, {{1, 6}}, 0, false, {}, next).empty());
  const TileOrder& order = given[0].order;
  REQUIRE(
      *first.Finish({1, order.tile, order.lease, 0, 0, 0, Depths()}, Bytes(32 * 32 * kColorWords * 4), 1));
  const auto more = AssignTiles({&first, &second}, {{1, 6}}, 1, false, {}, next);
  CHECK(more.size() == 1);
  CHECK(count(more, second) == 1);
}

TEST_CASE(
    "An idle worker fetches blocks for another's tile at the end of all frames, not while others follow") {
  View view;
  view.width = view.height = 64;  // four tiles
  REQUIRE(NormalizeView(view).has_value());
  const std::vector<uint32_t> bytes(1, 1000);
  for (const bool ending : {false, true}) {
    ActiveFrame frame(1, view, nullptr);
    BlockSet nothing;
    frame.MakePlan({{1, 1, 0, &nothing}}, {bytes, 1e-6, 1}, SchedulingPolicy::kFootprint);  // a second a tile
    // The first worker has one and comes to three more; fetching for one of them takes the other 1.5 s.
    REQUIRE(AssignTiles({&frame}, {{1, 1}}, 0, ending, {}, [] { return nullptr; }).size() == 1);
    const auto fetch_s = [](const ActiveFrame&, uint32_t, uint32_t) { return 1.5; };
    const auto taken = AssignTiles({&frame}, {{1, 1}, {2, 1}}, 0, ending, fetch_s, [] { return nullptr; });
    CHECK(taken.size() == (ending ? 1 : 0));
  }
}

TEST_CASE("Results count once, under a known lease; a dead worker's tiles are open again") {
  View view;
  view.width = view.height = 64;
  REQUIRE(NormalizeView(view).has_value());
  ActiveFrame frame(5, view, nullptr);
  const TileOrder first = frame.Lease({0, 1}, 0), second = frame.Lease({0, 2}, 1),
                  other = frame.Lease({1, 1}, 1);
  const Bytes pixels(32 * 32 * kColorWords * 4);
  CHECK_FALSE(*frame.Finish({4, 0, first.lease, 0, 0}, pixels, 2));  // another frame
  CHECK_FALSE(*frame.Finish({5, 0, 999, 0, 0}, pixels, 2));          // no such lease
  CHECK_FALSE(*frame.Finish({5, 2, first.lease, 0, 0}, pixels, 2));  // a lease of another tile
  CHECK_FALSE(frame.Finish({5, 0, first.lease, 0, 0, 0, Depths()}, Bytes(8), 2).has_value());
  const TileOrder third = frame.Lease({0, 3}, 1);
  CHECK_FALSE(frame.Finish({5, 0, third.lease, 0, 0, 0, {1, 2, 3}}, pixels, 2).has_value());
  CHECK(*frame.Finish({5, 0, second.lease, 10, 0, 0, Depths()}, pixels, 2));
  CHECK_FALSE(*frame.Finish({5, 0, first.lease, 10, 0, 0, Depths()}, pixels, 2));  // the straggler's
  CHECK(frame.tiles_done() == 1);
  CHECK(frame.counts().rays == 10);
  CHECK(frame.owners()[0] == 2);
  const auto held = [&](uint32_t worker) {
    std::unordered_map<uint32_t, uint32_t> all;
    frame.AddHeld(all);
    return all[worker];
  };
  CHECK(held(1) == 1);
  frame.Forget(1);
  CHECK(held(1) == 0);
  CHECK(frame.counts().leases_lost == 1);
  CHECK_FALSE(frame.MakeSnapshot({}, 2).tiles[1].done);
  CHECK(frame.MakeSnapshot({}, 2).tiles[1].held == false);
  CHECK_FALSE(*frame.Finish({5, 1, other.lease, 0, 0}, pixels, 2));
}

}  // namespace quarry

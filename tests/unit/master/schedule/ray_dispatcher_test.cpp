#include "master/schedule/ray_dispatcher.h"

#include <catch2/catch.hpp>
#include <deque>
#include <utility>
#include <vector>

namespace quarry {
namespace {

/// Two workers that are sent rays, and the hits that come of them.
struct Rays {
  Rays() {
    dispatcher.AddWorker(1);
    dispatcher.AddWorker(2);
  }
  uint32_t Ask() {
    return dispatcher.Ask({}, {}, [this](const RayDone& hit) { hits.push_back(hit.triangle); });
  }
  static RayDone HitOf(const RayOrder& order, uint32_t triangle) {
    return {order.ray, order.lease, 1, triangle, 0, 0};
  }

  std::vector<std::pair<uint32_t, RayOrder>> sent;
  std::vector<uint32_t> hits;
  RayDispatcher dispatcher{
      [this](uint32_t worker, const RayOrder& order) { sent.emplace_back(worker, order); }};
};

}  // namespace

TEST_CASE("Rays are sent to the workers that have fewest, and each is answered once", "[live]") {
  Rays rays;
  for (int i = 0; i < 4; ++i) rays.Ask();
  rays.dispatcher.Assign(0);
  rays.dispatcher.Assign(0);
  REQUIRE(rays.sent.size() == 4);
  for (int i = 0; i < 4; ++i) CHECK(rays.sent[static_cast<size_t>(i)].first == 1u + i % 2);
  const auto [worker, order] = rays.sent[2];
  rays.dispatcher.Finish(3 - worker, Rays::HitOf(order, 70));  // it is not this worker's
  RayDone other = Rays::HitOf(order, 71);
  ++other.lease;
  rays.dispatcher.Finish(worker, other);
  CHECK(rays.hits.empty());
  rays.dispatcher.Finish(worker, Rays::HitOf(order, 7));
  rays.dispatcher.Finish(worker, Rays::HitOf(order, 8));
  CHECK(rays.hits == std::vector<uint32_t>{7});
  rays.Ask();
  rays.dispatcher.Assign(0);
  CHECK(rays.sent.back().first == worker);
}

TEST_CASE(
    "A ray waits for a worker, moves on from one that is gone, and is given to one more when it is late",
    "[live]") {
  Rays rays;
  rays.dispatcher.RemoveWorker(1);
  rays.dispatcher.RemoveWorker(2);
  rays.Ask();
  rays.dispatcher.Assign(0);
  CHECK(rays.sent.empty());
  rays.dispatcher.AddWorker(3);
  rays.dispatcher.Assign(1);
  REQUIRE(rays.sent.size() == 1);
  rays.dispatcher.Assign(60);  // nobody else is there
  CHECK(rays.sent.size() == 1);
  rays.dispatcher.AddWorker(4);
  rays.dispatcher.Assign(61);
  rays.dispatcher.Assign(62);
  REQUIRE(rays.sent.size() == 2);
  CHECK(rays.sent[1].first == 4);
  rays.dispatcher.RemoveWorker(3);
  rays.dispatcher.RemoveWorker(4);
  rays.dispatcher.Finish(4, Rays::HitOf(rays.sent[1].second, 5));
  CHECK(rays.hits.empty());
  rays.dispatcher.AddWorker(5);
  rays.dispatcher.Assign(63);
  REQUIRE(rays.sent.size() == 3);
  rays.dispatcher.Finish(5, Rays::HitOf(rays.sent[2].second, 6));
  CHECK(rays.hits == std::vector<uint32_t>{6});
}

TEST_CASE("A ray that is forgotten is not answered", "[live]") {
  Rays rays;
  const uint32_t first = rays.Ask(), second = rays.Ask();
  rays.dispatcher.Forget(first);
  rays.dispatcher.Assign(0);
  REQUIRE(rays.sent.size() == 1);
  rays.dispatcher.Forget(second);
  rays.dispatcher.Finish(rays.sent[0].first, Rays::HitOf(rays.sent[0].second, 5));
  rays.dispatcher.Assign(100);
  CHECK((rays.hits.empty() && rays.sent.size() == 1));
}

}  // namespace quarry

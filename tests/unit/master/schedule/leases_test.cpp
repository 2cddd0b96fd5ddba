#include "master/schedule/leases.h"

#include <catch2/catch.hpp>

namespace quarry {
namespace {

std::vector<uint32_t> Late(const Leases& leases, double now_s, uint32_t silent = 0) {
  return leases.Late(
      now_s, [](uint32_t) { return 1.0; }, [=](uint32_t worker) { return worker != silent; });
}

}  // namespace

TEST_CASE("A lease ends once, with its own tile, its worker or all leases of its tile") {
  Leases leases;
  const uint64_t first = leases.Give(7, 1, 0), second = leases.Give(7, 2, 1), other = leases.Give(9, 1, 2);
  REQUIRE(leases.Of(7).size() == 2);
  CHECK(leases.Of(7)[0].worker == 1);  // the oldest
  CHECK(leases.Holds(2, 7));
  CHECK_FALSE(leases.Holds(2, 9));
  CHECK_FALSE(leases.End(9, first));  // of another tile
  const auto ended = leases.End(7, second);
  REQUIRE(ended);
  CHECK((ended->worker == 2 && ended->since_s == 1));
  CHECK_FALSE(leases.End(7, second));
  leases.GiveBack(2, other);  // which it does not hold
  CHECK(leases.size() == 2);
  leases.GiveBack(1, other);
  CHECK(leases.size() == 1);
  leases.Give(8, 1, 3), leases.Give(8, 3, 3);
  CHECK(leases.Forget(1) == std::vector<uint32_t>{7, 8});
  CHECK(leases.size() == 1);
  leases.EndAll(8);
  CHECK(leases.size() == 0);
  CHECK(leases.Give(7, 1, 4) > other);  // no number comes back
}

TEST_CASE("A tile is late after twice the time with each holder that answers, and at once if none does") {
  Leases leases;
  leases.Give(5, 1, 0.5);
  leases.Give(3, 2, 0.75);
  CHECK(Late(leases, 1.5).empty());
  CHECK(Late(leases, 2) == std::vector<uint32_t>{5, 3});  // the oldest first
  CHECK(Late(leases, 1, 2) == std::vector<uint32_t>{3});
  leases.Give(5, 3, 2);
  CHECK(Late(leases, 4) == std::vector<uint32_t>{3});
  CHECK(Late(leases, 4.5) == std::vector<uint32_t>{3, 5});
  CHECK(Late(leases, 3.5, 1) == std::vector<uint32_t>{3, 5});  // the second holder is the first that answers
}

}  // namespace quarry

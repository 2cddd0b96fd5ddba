#include "master/schedule/wait_budget.h"

#include <catch2/catch.hpp>

namespace quarry {

TEST_CASE("A frame waits for half a second, and again after ten times as long") {
  WaitBudget patience;
  CHECK_FALSE(patience.Waits(100, false));
  CHECK(patience.Waits(100, true));
  CHECK(patience.Waits(100.4, true));
  CHECK_FALSE(patience.Waits(100.6, true));
  CHECK_FALSE(patience.Waits(100.7, true));
  CHECK(patience.Waits(103, true));
  CHECK_FALSE(patience.Waits(103.3, true));
}

TEST_CASE("A predicted frame waits no longer, and unused waiting time is kept") {
  WaitBudget patience;
  CHECK(patience.Waits(1, true));
  CHECK_FALSE(patience.Waits(1.1, false));
  CHECK_FALSE(patience.Waits(60, false));
  CHECK(patience.Waits(60, true));
  CHECK(patience.Waits(60.45, true));
}

}  // namespace quarry

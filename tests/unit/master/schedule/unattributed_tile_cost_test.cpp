#include "master/schedule/unattributed_tile_cost.h"

#include <catch2/catch.hpp>

namespace quarry {

TEST_CASE("The unattributed cost of tiles is the busy time of threads less tracing and decoding",
          "[overhead]") {
  UnattributedTileCost overhead;
  CHECK(overhead.seconds() == 0);
  overhead.Busy(10, 3);  // three threads from 10 s on
  overhead.Busy(12, 1);  // one from 12 s on: 6 s so far
  overhead.Busy(13, 0);  // 7 s
  overhead.Busy(20, 0);
  CHECK(overhead.seconds() == 0);  // no tile is done yet
  overhead.Done(1);
  overhead.Done(2);
  CHECK(overhead.seconds() == Approx(2));
  overhead.Decoded(3);
  CHECK(overhead.seconds() == Approx(0.5));
  overhead.Decoded(3);
  CHECK(overhead.seconds() == Approx(0.5));
  overhead.Decoded(1);  // a worker has left, with its decoded blocks
  CHECK(overhead.seconds() == Approx(0.5));
  overhead.Decoded(10);  // more than there was
  CHECK(overhead.seconds() == 0);
}

TEST_CASE("Old measurements count for less", "[overhead]") {
  UnattributedTileCost overhead;
  for (int i = 0; i < 100; ++i) {
    overhead.Busy(i, 1);
    overhead.Done(0);
    overhead.Fade();
  }
  CHECK(overhead.seconds() == Approx(1).epsilon(0.01));
  for (int i = 0; i < 100; ++i) {
    overhead.Busy(100 + 3 * i, 1);
    overhead.Done(0);
    overhead.Fade();
  }
  CHECK(overhead.seconds() == Approx(3).epsilon(0.01));
}

}  // namespace quarry

#include "common/engine/adaptive_queue_depth.h"

#include <catch2/catch.hpp>

#include "master/schedule/dispatcher.h"

namespace quarry {

TEST_CASE("More tiles are requested while threads starve, and fewer as soon as they do not", "[window]") {
  AdaptiveQueueDepth window(2);
  CHECK(window.wanted() == FewestTiles(2));
  window.Finished();
  CHECK(window.wanted() == FewestTiles(2));
  for (int i = 0; i < 3; ++i) {
    window.Starved();
    window.Starved();  // once a tile
    window.Finished();
  }
  CHECK(window.wanted() == FewestTiles(2) + 3);
  window.Finished();
  CHECK(window.wanted() == FewestTiles(2) + 2);
  for (int i = 0; i < 100; ++i) {
    window.Starved();
    window.Finished();
  }
  CHECK(window.wanted() == MostTiles(2));
}

TEST_CASE("Most tiles are requested at once where blocks push each other out of the cache", "[window]") {
  AdaptiveQueueDepth window(2);
  window.Starved(true);
  CHECK(window.wanted() == MostTilesIfScarce(2));
  window.Finished();
  CHECK(window.wanted() == MostTilesIfScarce(2));
  window.Finished();
  CHECK(window.wanted() == MostTilesIfScarce(2) - 1);
}

TEST_CASE("A worker gets as many tiles as it wants, within bounds", "[window]") {
  WorkerState worker;
  worker.threads = 3;
  CHECK(worker.Credit(false) == FewestTiles(3));  // it has not said
  worker.tiles_wanted = FewestTiles(3) + 1;
  CHECK(worker.Credit(false) == FewestTiles(3));  // nor answered
  worker.tiles = 1;
  CHECK(worker.Credit(false) == FewestTiles(3) + 1);
  worker.tiles_wanted = 1000000;
  CHECK(worker.Credit(false) == MostTilesIfScarce(3));
  worker.tiles_wanted = 1;
  CHECK(worker.Credit(false) == FewestTiles(3));
}

}  // namespace quarry

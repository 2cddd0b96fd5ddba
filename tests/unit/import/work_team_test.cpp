#include "preprocess/import/work_team.h"

#include <atomic>
#include <catch2/catch.hpp>
#include <stdexcept>
#include <thread>

using quarry::WorkTeam;

TEST_CASE("A team makes each call of a loop once", "[import][team]") {
  for (const unsigned helpers : {0u, 1u, 7u}) {
    WorkTeam team(helpers);
    CHECK(team.threads() == helpers + 1);
    for (const size_t count : {0u, 1u, 2u, 1000u}) {
      std::vector<std::atomic<int>> calls(count);
      team.ForEach(count, [&](size_t i) { ++calls[i]; });
      size_t wrong = 0;
      for (const std::atomic<int>& n : calls) wrong += n != 1;
      CHECK(wrong == 0);
    }
  }
}

TEST_CASE("Several threads share a team's helpers", "[import][team]") {
  WorkTeam team(3);
  std::atomic<size_t> sum = 0;
  std::vector<std::thread> callers;
  for (int caller = 0; caller < 4; ++caller)
    callers.emplace_back([&] {
      for (int loop = 0; loop < 200; ++loop) team.ForEach(20, [&](size_t i) { sum += i; });
    });
  for (std::thread& caller : callers) caller.join();
  CHECK(sum == 4 * 200 * 190);
}

TEST_CASE("What a team's work throws reaches the caller, and later loops run", "[import][team]") {
  WorkTeam team(3);
  const auto fails = [](size_t i) {
    if (i % 100 == 42) throw std::runtime_error("no");
  };
  for (int again = 0; again < 20; ++again) CHECK_THROWS_AS(team.ForEach(1000, fails), std::runtime_error);
  std::atomic<size_t> calls = 0;
  team.ForEach(1000, [&](size_t) { ++calls; });
  CHECK(calls == 1000);
}

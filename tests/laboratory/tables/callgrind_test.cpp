#include "tests/laboratory/tables/callgrind.h"

#include <catch2/catch.hpp>
#include <cstdlib>
#include <sstream>

#include "tests/support/skip.h"

namespace quarry::laboratory {
namespace {

const std::vector<std::string> kFunctions{"probe::Inner", "probe::Outer(unsigned long)",
                                          "quarry::laboratory::probe::Outer(unsigned long)", "probe::Never"};

const std::string kProbe = QUARRY_LABORATORY_PROBE;

bool SkippedWithoutValgrind() {
  if (ValgrindInstalled()) return false;
  test::Skip("valgrind is not installed on this machine");
  return true;
}

FunctionCosts Count(int calls) {
  const auto costs = CountInstructions({kProbe, std::to_string(calls)}, kFunctions);
  if (!costs) FAIL(costs.error().message);
  return *costs;
}

TEST_CASE("Calls and instructions of a program are counted", "[laboratory]") {
  if (SkippedWithoutValgrind()) return;
  FunctionCosts few = Count(50), many = Count(100);
  CHECK(few["probe::Inner"].calls == 150);
  CHECK(few[kFunctions[1]].calls == 50);
  CHECK(many["probe::Inner"].calls == 300);
  CHECK(many[kFunctions[1]].calls == 100);
  for (const std::string name : {"probe::Inner", kFunctions[1].c_str()}) {
    CAPTURE(name);
    const auto n = static_cast<double>(few[name].instructions);
    CHECK(static_cast<double>(many[name].instructions) == Approx(2 * n).epsilon(0.01));
  }
  // Inner: 100 steps of at least six instructions. Outer: Inner, and less than 50 instructions a call of its
  // own.
  CHECK(few["probe::Inner"].instructions >= 150 * 600);
  CHECK(few[kFunctions[1]].instructions > few["probe::Inner"].instructions);
  CHECK(few[kFunctions[1]].instructions < few["probe::Inner"].instructions + 50 * 50);
  // A part of the name, or the name itself.
  CHECK(few[kFunctions[1]].instructions == few[kFunctions[2]].instructions);
  CHECK(few["probe::Never"].calls == 0);
  CHECK(few["probe::Never"].instructions == 0);
}

TEST_CASE("A program that fails under valgrind is reported with its status", "[laboratory]") {
  if (SkippedWithoutValgrind()) return;
  const auto failed = CountInstructions({kProbe, "1", "3"}, kFunctions);
  REQUIRE(!failed);
  CHECK(failed.error().message == kProbe + " failed with status 3 under valgrind: the probe fails as asked");
  const auto aborted = CountInstructions({kProbe, "1", "-1"}, kFunctions);
  REQUIRE(!aborted);
  CHECK_THAT(aborted.error().message, Catch::Contains("failed with status 6"));
  const auto missing = CountInstructions({kProbe + "-missing"}, kFunctions);
  REQUIRE(!missing);
  CHECK_THAT(missing.error().message, Catch::Contains("failed with status"));
}

TEST_CASE("A machine without valgrind gets an error", "[laboratory]") {
  const char* path = ::getenv("PATH");
  const std::string kept = path ? path : "";
  ::setenv("PATH", "/nonexistent", 1);
  const bool installed = ValgrindInstalled();
  const auto costs = CountInstructions({kProbe, "1"}, kFunctions);
  ::setenv("PATH", kept.c_str(), 1);
  CHECK(!installed);
  REQUIRE(!costs);
  CHECK_THAT(costs.error().message, Catch::Contains("no valgrind"));
}

constexpr const char* kProfile = R"(# callgrind format
version: 1
creator: by hand
positions: line
events: Ir
summary: 60

fl=probe.cpp
fn=main
0 20
cfn=outer(int)
calls=2 0
0 36
fn=outer(int)
0 4
cfi=other.cpp
cfn=inner(int)
calls=6 0
0 32
fn=inner(int)
fe=other.cpp
0 32
fn=inner(long)
0 4

totals: 60
)";

TEST_CASE("A profile's names and costs are read", "[laboratory]") {
  const std::vector<std::string> functions{"main", "outer", "inner", "inner(int)", "other"};
  std::istringstream profile(kProfile);
  auto costs = ReadCallgrindProfile(profile, "p", functions);
  if (!costs) FAIL(costs.error().message);
  FunctionCosts& c = *costs;
  CHECK(c["main"].instructions == 56);  // 20 of its own, 36 of outer
  CHECK(c["main"].calls == 0);
  CHECK(c["outer"].calls == 2);
  CHECK(c["outer"].instructions == 36);  // 4 of its own, 32 of inner
  CHECK(c["inner(int)"].calls == 6);
  CHECK(c["inner(int)"].instructions == 32);
  CHECK(c["inner"].calls == 6);
  CHECK(c["inner"].instructions == 36);  // both
  CHECK(c["other"].instructions == 0);
}

TEST_CASE("A profile that does not add up is refused", "[laboratory]") {
  const auto message = [](const std::string& text) {
    std::istringstream profile(text);
    const auto costs = ReadCallgrindProfile(profile, "p", {});
    return costs ? std::string() : costs.error().message;
  };
  CHECK(message("events: Ir\nfn=f\n0 2\ntotals: 2\n").empty());
  CHECK(message("events: Ir\nfn=f\n0 2\n") == "p: the functions have 2 instructions, and the total is 0");
  CHECK(message("events: Ir\nfn=f\n0 2\ntotals: 3\n") ==
        "p: the functions have 2 instructions, and the total is 3");
  // Without the line of its caller, the callee's cost counts twice.
  CHECK(message("events: Ir\nfn=f\n0 2\ncalls=1 0\n0 1\nfn=g\n0 1\ntotals: 3\n") ==
        "p: the functions have 4 instructions, and the total is 3");
}

}  // namespace
}  // namespace quarry::laboratory

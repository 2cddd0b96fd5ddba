#define CATCH_CONFIG_RUNNER
#include <catch2/catch.hpp>
#include <cstdio>

#include "tests/support/skip.h"

namespace {

int skipped = 0;

}  // namespace

void quarry::test::Skip(const std::string& reason) {
  ++skipped;
  WARN("skipped: " << reason);
}

int main(int argc, char** argv) {
  constexpr int kSkipped = 77;
  const int failed = Catch::Session().run(argc, argv);
  if (failed == 0 && skipped > 0) std::printf("%d tests, or parts of them, were skipped\n", skipped);
  return failed == 0 && skipped > 0 ? kSkipped : failed;
}

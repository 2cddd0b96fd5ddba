#include "common/base/number.h"

#include <catch2/catch.hpp>
#include <limits>

namespace quarry {

TEST_CASE("Whole numbers of options neither wrap nor hide", "[numbers]") {
  const NumberCheck byte = WholeNumber(1, 255), any = WholeNumber(0, std::numeric_limits<uint64_t>::max());
  for (const char* good : {"1", "10", "255"}) CHECK(byte(good) == "");
  for (const char* bad : {"", "0", "256", "-1", "+1", " 1", "1 ", "0x10", "010", "1e2", "1.0", "4294967297",
                          "18446744073709551617", "99999999999999999999999", "nan"})
    CHECK(byte(bad) != "");
  CHECK(any("18446744073709551615") == "");
  CHECK(any("0") == "");
  for (const char* bad : {"-1", "18446744073709551616"}) CHECK(any(bad) != "");
}

TEST_CASE("Numbers of options are numbers", "[numbers]") {
  const NumberCheck check = RealNumber(0, 1e6);
  for (const char* good : {"0", "0.5", "1e6", "-0"}) CHECK(check(good) == "");
  for (const char* bad : {"", "nan", "inf", "-1", "1e7", "1e999", "0x10", "1x", "-nan"})
    CHECK(check(bad) != "");
}

TEST_CASE("Counts between separators are taken as written", "[numbers]") {
  uint32_t out[4];
  REQUIRE(ParseCounts("640x480", "x", std::span(out, 2)));
  CHECK((out[0] == 640 && out[1] == 480));
  REQUIRE(ParseCounts("0,1,2,4294967295", ",,,", out));
  CHECK(out[3] == 4294967295);
  CHECK(ParseCounts("12", "", std::span(out, 1)));
  for (const char* bad : {"", "x", "640", "640x", "x480", "640x480x1", "4294967297x64", "64x4294967296",
                          "-5x-5", "5x-5", "640 x480", "640X480", "0x10x5", "1e3x5"})
    CHECK_FALSE(ParseCounts(bad, "x", std::span(out, 2)));
  CHECK_FALSE(ParseCounts("0-4294967296", "-", std::span(out, 2)));
}

}  // namespace quarry

#include "common/scene/render_mode.h"

#include <catch2/catch.hpp>
#include <set>

namespace quarry {

TEST_CASE("Each mode has its line in the table, under a name of its own") {
  std::set<std::string> names;
  for (int number = 0; number < kRenderModes; ++number) {
    const auto mode = static_cast<RenderMode>(number);
    const RenderModeInfo& info = InfoOf(mode);
    REQUIRE(&info < std::end(kRenderModeInfo));
    CHECK(info.mode == mode);
    CHECK(info.default_spp > 0);
    CHECK(FindRenderMode(info.name) == mode);
    names.insert(info.name);
  }
  CHECK(names.size() == kRenderModes);
  CHECK(RenderModeNames().size() == kRenderModes);
  CHECK_FALSE(FindRenderMode("").has_value());
  CHECK_FALSE(FindRenderMode("Ao").has_value());
}

}  // namespace quarry

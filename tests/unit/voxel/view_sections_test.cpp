#include "common/voxel/view_sections.h"

#include <catch2/catch.hpp>
#include <cstring>

namespace quarry {
namespace {

constexpr size_t kEntry = 64;

Bytes TwoLights() {
  std::vector<NamedLight> lights = {{"lamp", LightKind::kPoint}, {"panel", LightKind::kRectangle}};
  lights[1].edges[0] = {1, 0, 0};
  lights[1].edges[1] = {0, 2, 0};
  std::string names;
  return EncodeLights(lights, names);
}

bool Decodes(const Bytes& bytes) {
  return DecodeLights(bytes, [](uint32_t) -> Result<std::string> { return std::string("n"); }).has_value();
}

}  // namespace

TEST_CASE("Damaged rectangles of a model's lights are refused", "[store]") {
  const Bytes right = TwoLights();
  REQUIRE(right.size() == 3 * kEntry);  // a rectangle takes two entries
  CHECK(Decodes(right));
  const auto with = [&](size_t at, uint32_t value) {
    Bytes bytes = right;
    std::memcpy(bytes.data() + at, &value, sizeof value);
    return Decodes(bytes);
  };
  CHECK_FALSE(with(kEntry + 4, 258));    // 2 in its low byte
  CHECK_FALSE(with(kEntry + 4, 3));      // sides without their rectangle
  CHECK_FALSE(with(2 * kEntry, 1));      // words that are 0
  CHECK_FALSE(with(2 * kEntry + 4, 0));  // no sides
  CHECK_FALSE(with(2 * kEntry + 8, 0));  // no area
  CHECK_FALSE(with(2 * kEntry + 60, 1));
  Bytes cut = right;
  cut.resize(2 * kEntry);
  CHECK_FALSE(Decodes(cut));
}

}  // namespace quarry

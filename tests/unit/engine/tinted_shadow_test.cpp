// Shadow rays pass panes of glass: light on a floor is multiplied once for each pane between it and the
// light.
#include <array>
#include <cmath>
#include <cstring>
#include <fstream>
#include <string>

#include "common/engine/ask_rays.h"
#include "common/engine/integrators/bounce.h"
#include "tests/support/models/made_store.h"
#include "tests/support/rendering/engine_run.h"
#include "tests/support/temporary_folder.h"

namespace quarry::test {
namespace {

constexpr int kStrips = 8;
constexpr uint32_t kPixels = 32;  ///< a side of the picture; a strip takes four columns
constexpr float kHalf = 4;        ///< the floor reaches from -kHalf to kHalf along x and y
constexpr glm::vec3 kTint{0.9f, 0.8f, 0.5f};
/// Panes over each strip of the floor, one above the other.
constexpr std::array<int, kStrips> kPanes{0, 1, 2, 5, 32, 33, 3, 2};
constexpr int kLid = 6;      ///< this strip has an opaque lid above its panes
constexpr int kFresnel = 7;  ///< this strip's panes reflect a part of the light
constexpr float kLidHeight = 5;

float HeightOf(int pane) { return 1 + 0.1f * static_cast<float>(pane); }

/// A floor; with `panes`, also the panes and the lid above it.
StoreReader MakeStore(const TemporaryFolder& folder, bool panes) {
  const std::string name = panes ? "panes" : "floor";
  std::ofstream(folder.file("glass.mtl"))
      << "newmtl wall\nKd 0.8 0.8 0.8\nnewmtl glass\nKd 0 0 0\nTf 0.9 0.8 0.5\nNi 1.5\nillum 6\n"
         "newmtl fresnel\nKd 0 0 0\nTf 0.9 0.8 0.5\nNi 1.5\nillum 7\n";
  std::ofstream out(folder.file(name + ".obj"));
  out << "mtllib glass.mtl\n";
  const auto square = [&](const char* material, float left, float right, float height) {
    for (const auto& [x, y] :
         {std::pair(left, -kHalf), std::pair(right, -kHalf), std::pair(right, kHalf), std::pair(left, kHalf)})
      out << "v " << x << ' ' << y << ' ' << height << '\n';
    out << "usemtl " << material << "\nf -4 -3 -2 -1\n";
  };
  square("wall", -kHalf, kHalf, 0);
  for (int strip = 0; strip < kStrips && panes; ++strip) {
    const float left = static_cast<float>(strip) - kHalf;
    for (int pane = 0; pane < kPanes[static_cast<size_t>(strip)]; ++pane)
      square(strip == kFresnel ? "fresnel" : "glass", left, left + 1, HeightOf(pane));
    if (strip == kLid) square("wall", left, left + 1, kLidHeight);
  }
  out.close();
  const std::string path = folder.file(name + ".quarry");
  test::MakeStore({.models = {folder.file(name + ".obj")}, .output = path, .voxel_size = 4096});
  auto store = StoreReader::Open(path);
  REQUIRE(store.has_value());
  return std::move(*store);
}

/// The floor from above, from below the panes.
View FloorView(RenderMode mode, const Light& light) {
  View view;
  view.width = view.height = kPixels;
  view.mode = mode;
  view.ambient = glm::vec3(0);
  view.camera = CameraSpec{.eye = {0, 0, 0.5}, .at = {0, 0, 0}, .up = {0, 1, 0}, .ortho_height = 2 * kHalf};
  view.lights = {light};
  REQUIRE(NormalizeView(view).has_value());
  return view;
}

glm::vec3 PixelAt(const Bytes& tile, uint32_t x, uint32_t y) {
  float rgb[3];
  std::memcpy(rgb, tile.data() + (size_t{y} * kPixels + x) * 4 * kColorWords, sizeof rgb);
  return {rgb[0], rgb[1], rgb[2]};
}

/// The share of the light that comes to the floor at `x`, by counting panes. `clear`: false where the ray
/// passes so near to a border of strips that the pixel's samples may differ.
glm::vec3 SharePassed(float x, const Light& light, bool& clear) {
  const bool sun = light.kind == LightKind::kSun;
  const float top = sun ? kInfinity : light.vector.z;
  const float slope = sun ? light.vector.x / light.vector.z : (light.vector.x - x) / light.vector.z;
  clear = true;
  const auto crosses = [&](int strip, float height) {
    const float at = x + slope * height + kHalf - static_cast<float>(strip);
    if (height > top) return false;
    clear &= std::fabs(at) > 0.3f && std::fabs(at - 1) > 0.3f;
    return at > 0 && at < 1;
  };
  int passed = 0;
  glm::vec3 share(1);
  for (int strip = 0; strip < kStrips; ++strip) {
    for (int pane = 0; pane < kPanes[static_cast<size_t>(strip)]; ++pane) {
      if (!crosses(strip, HeightOf(pane))) continue;
      ++passed;
      share *= kTint;
      if (strip == kFresnel) share *= 0.96f;
    }
    if (strip == kLid && crosses(strip, kLidHeight)) share = glm::vec3(0);
  }
  return passed > static_cast<int>(kMostPassed) ? glm::vec3(0) : share;
}

}  // namespace

TEST_CASE("Light on a floor is multiplied once for each pane of glass in front of the light", "[going_on]") {
  const TemporaryFolder folder;
  const StoreReader with = MakeStore(folder, true), without = MakeStore(folder, false);
  const Light lights[] = {{LightKind::kSun, {0, 0, 1}, glm::vec3(1)},
                          {LightKind::kSun, {0.3f, 0, 1}, glm::vec3(1)},
                          {LightKind::kPoint, {-0.5f, 0, 1.25f}, glm::vec3(4)}};
  const uint64_t all = uint64_t{64} << 20, largest = with.catalog().meta.largest_decoded;
  constexpr std::chrono::seconds kMost(60);
  for (const Light& given : lights)
    for (const RenderMode mode : {RenderMode::kShadow, RenderMode::kWhitted}) {
      const View view = FloorView(mode, given);
      const Light& light = view.lights[0];
      const EngineRun tinted = RunEngine(with, view, all, 1, kMost),
                      open = RunEngine(without, view, all, 1, kMost);
      REQUIRE((tinted.ended && open.ended && tinted.tiles.size() == 1 && open.tiles.size() == 1));
      uint32_t compared = 0;
      for (uint32_t x = 0; x < kPixels; ++x) {
        const float at = (static_cast<float>(x) + 0.5f) * 2 * kHalf / kPixels - kHalf;
        bool clear = false;
        const glm::vec3 share = SharePassed(at, light, clear);
        // A slanted ray to the fresnel panes reflects another share.
        if (!clear || (light.vector.x != 0 && at > 2)) continue;
        const glm::vec3 lit = PixelAt(open.tiles[0], x, kPixels / 2),
                        seen = PixelAt(tinted.tiles[0], x, kPixels / 2);
        INFO("light " << light.vector.x << ", column " << x);
        CHECK(lit.x > 0.01f);
        for (int c = 0; c < 3; ++c) CHECK(seen[c] == Approx(lit[c] * share[c]).epsilon(1e-5).margin(1e-7));
        ++compared;
      }
      CHECK(compared >= 4);
      for (const unsigned threads : {1u, 2u})
        CHECK(RunEngine(with, view, largest, threads, kMost).tiles == tinted.tiles);
    }
}

TEST_CASE("Glass stops the short rays of ambient occlusion, as it is drawn", "[going_on]") {
  const TemporaryFolder folder;
  const StoreReader with = MakeStore(folder, true), without = MakeStore(folder, false);
  View view = FloorView(RenderMode::kAo, {});
  view.ao_distance = 8;
  view.ao_samples = 16;
  const uint64_t all = uint64_t{64} << 20;
  constexpr std::chrono::seconds kMost(60);
  const Bytes roofed = RunEngine(with, view, all, 1, kMost).tiles[0],
              open = RunEngine(without, view, all, 1, kMost).tiles[0];
  CHECK(PixelAt(roofed, 14, kPixels / 2).x < 0.8f * PixelAt(open, 14, kPixels / 2).x);
}

TEST_CASE("A see-through surface passes its transmittance, less what it reflects", "[going_on]") {
  Material glass;
  CHECK_FALSE(LetsLightThrough(glass));
  glass.transmittance = kTint;
  CHECK(LetsLightThrough(glass));
  CHECK(PassedLight(glass, 1) == kTint);
  CHECK(PassedLight(glass, 0.1f) == kTint);
  glass.fresnel = true;
  glass.specular_ior = 1.5f;
  CHECK(PassedLight(glass, 1).x == Approx(0.96f * kTint.x));
  CHECK(PassedLight(glass, 0).x == 0);
  Surface s;
  s.normal = s.geometric_normal = s.view = {0, 0, 1};
  CHECK(PassedLight(glass, 1) == Bounce(glass, s).refract_weight);
}

TEST_CASE("Glass is a hit for rays of a list, whichever hit they ask for", "[going_on]") {
  const TemporaryFolder folder;
  const Scene scene(std::make_shared<const StoreReader>(MakeStore(folder, true)));
  const auto renderer = Renderer::Create(scene, {64 << 20, 2});
  REQUIRE(renderer.has_value());
  std::vector<RayQuery> rays;
  for (int strip = 0; strip < kStrips; ++strip)
    rays.push_back({{strip - static_cast<double>(kHalf) + 0.5, 0.25, 0.5}, {0, 0, 1}, 4.0});
  for (const RayGoal goal : {RayGoal::kNearest, RayGoal::kAny}) {
    const auto hits = HitsOf(**renderer, rays, goal);
    REQUIRE(hits.has_value());
    for (size_t strip = 0; strip < rays.size(); ++strip) {
      INFO(strip);
      const bool hit = kPanes[strip] > 0;
      CHECK(((*hits)[strip].triangle != kNoTriangle) == hit);
      if (hit && goal == RayGoal::kNearest)
        CHECK((*hits)[strip].t == Approx(HeightOf(0) - 0.5f).epsilon(1e-5));
    }
  }
}

}  // namespace quarry::test

#include "preprocess/texture/cut_outs.h"

#include <catch2/catch.hpp>
#include <cmath>
#include <csignal>
#include <fstream>
#include <numeric>
#include <random>
#include <set>

#include "tests/support/temporary_folder.h"

namespace quarry {
namespace {

/// A grey image of blobs, as PGM, so that there are areas of 0 and of 255 and borders between them.
struct Grey {
  int width, height;
  std::vector<uint8_t> values;

  Grey(int w, int h, unsigned seed) : width(w), height(h), values(static_cast<size_t>(w * h)) {
    std::mt19937 random(seed);
    for (int blob = 0; blob < 6; ++blob) {
      const int cx = static_cast<int>(random() % static_cast<unsigned>(w));
      const int cy = static_cast<int>(random() % static_cast<unsigned>(h));
      const int r = 3 + static_cast<int>(random() % 12);
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
          const int d = (x - cx) * (x - cx) + (y - cy) * (y - cy);
          uint8_t& v = values[static_cast<size_t>(y * w + x)];
          if (d < r * r)
            v = 255;
          else if (d < (r + 2) * (r + 2))
            v = std::max(v, static_cast<uint8_t>(100 + random() % 100));
        }
    }
  }
  void Write(const std::string& path) const {
    std::ofstream out(path, std::ios::binary);
    out << "P5 " << width << " " << height << " 255\n";
    out.write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(values.size()));
  }
  static int Wrapped(int i, int size, TextureWrap wrap) {
    if (wrap == TextureWrap::kClamp) return std::clamp(i, 0, size - 1);
    const int period = wrap == TextureWrap::kMirror ? 2 * size : size;
    i = (i % period + period) % period;
    return i < size ? i : 2 * size - 1 - i;
  }
  float At(int x, int y, const TextureBinding& b) const {
    const int at = Wrapped(y, height, b.wrap_t) * width + Wrapped(x, width, b.wrap_s);
    return b.factor.w * static_cast<float>(values[static_cast<size_t>(at)]) / 255;
  }
};

/// Whether all texels of a lookup at barycentric (b1, b2) are opaque, and transparent, as shading computes
/// it.
TexelStates LookUp(const Grey& image, const TriangleRecord& t, const TextureBinding& b, float b1, float b2) {
  const glm::vec2 uv = (1 - b1 - b2) * t.uvs[0] + b1 * t.uvs[1] + b2 * t.uvs[2];
  const auto& m = b.transform;
  const float x = (m[0] * uv.x + m[1] * uv.y + m[2]) * static_cast<float>(image.width);
  const float y = (m[3] * uv.x + m[4] * uv.y + m[5]) * static_cast<float>(image.height);
  TexelStates states;
  const OpacityRule rule{1, b.cutoff};
  const auto left = static_cast<int>(std::floor(x - 0.5f)), top = static_cast<int>(std::floor(y - 0.5f));
  for (int dy = 0; dy < 2; ++dy)
    for (int dx = 0; dx < 2; ++dx) states.Meet(rule.StatesOf(image.At(left + dx, top + dy, b)));
  states.Meet(rule.StatesOf(image.At(static_cast<int>(std::floor(x)), static_cast<int>(std::floor(y)), b)));
  return states;
}

TextureImage ImageIn(const std::string& file) {
  TextureImage image;
  image.file = image.name = file;
  image.model = file;
  image.color = false;
  image.pick = TexturePick::kScalar;
  return image;
}

Material Mapped(const TextureBinding& binding) {
  Material material;
  material.textures = {binding};
  return material;
}

ImageDecoding Helper() {
  ::signal(SIGPIPE, SIG_IGN);
  return {std::string(QUARRY_BIN_DIR) + "/quarry-import-image", 64 << 20};
}

}  // namespace

TEMPLATE_TEST_CASE_SIG("A point lies in one of 16 or 1,024 sub-triangles of equal area", "[texture]",
                       ((uint32_t kParts), kParts), kMaskSteps, kFineMaskSteps) {
  // The corners of a sub-triangle and points near them give its number, the borders' points one of those
  // about.
  constexpr uint32_t kAll = kParts * kParts;
  std::vector<int> points(kAll);
  constexpr int kSteps = 1600;
  int all = 0;
  for (int i = 0; i < kSteps; ++i)
    for (int j = 0; i + j < kSteps; ++j, ++all) {
      const float b1 = (static_cast<float>(i) + 0.33f) / kSteps,
                  b2 = (static_cast<float>(j) + 0.33f) / kSteps;
      const uint32_t sub = SubTriangleOf<kParts>(b1, b2);
      if (sub < kAll) ++points[sub];
    }
  CHECK(std::accumulate(points.begin(), points.end(), 0) == all);
  for (const int count : points) CHECK(std::abs(count - all / int{kAll}) < all / int{kAll} / 8);
  for (const float beyond : {-1e-6f, 1 + 1e-6f, 1e30f, -1e30f, std::nanf("")}) {
    CHECK(SubTriangleOf<kParts>(beyond, 0.1f) < kAll);
    CHECK(SubTriangleOf<kParts>(0.1f, beyond) < kAll);
  }
}

TEST_CASE("Sub-triangles are numbered row by row", "[texture]") {
  CHECK(SubTriangleOf<4>(0, 0) == 0);
  CHECK(SubTriangleOf<4>(1, 0) == 6);
  CHECK(SubTriangleOf<4>(0, 1) == 15);
  CHECK(SubTriangleOf<4>(0.3f, 0.3f) == 9);    // in the inner triangle
  CHECK(SubTriangleOf<4>(0.24f, 0.24f) == 1);  // inverted, beside the first corner's
  CHECK(SubTriangleOf<16>(1, 0) == 30);
  CHECK(SubTriangleOf<16>(0, 1) == 255);
  CHECK(SubTriangleOf<16>(0, 0.07f) == 31);  // the first of the second row
}

TEST_CASE("Masks claim only what all touched texels confirm, and little less", "[texture]") {
  const test::TemporaryFolder folder;
  const Grey image(150, 90, 4);
  image.Write(folder.file("g.pgm"));
  std::mt19937 random(7);
  std::uniform_real_distribution<float> unit(0, 1);
  std::vector<Material> materials;
  for (const TextureWrap wrap : {TextureWrap::kRepeat, TextureWrap::kClamp, TextureWrap::kMirror})
    for (const float cutoff : {0.0f, 0.5f}) {
      TextureBinding b;
      b.use = TextureUse::kOpacity;
      b.texture = 0;
      b.wrap_s = wrap;
      b.wrap_t = materials.size() % 4 < 2 ? wrap : TextureWrap::kMirror;
      b.transform = {0.7f, -0.4f, 0.2f, 0.3f, 1.1f, -0.6f};
      b.cutoff = cutoff;
      materials.push_back(Mapped(b));
    }
  Progress progress(true);
  const auto cut_outs =
      CutOuts::Read(materials, {ImageIn(folder.file("g.pgm"))}, Helper(), folder.file("tiles"), progress);
  REQUIRE(cut_outs);
  uint64_t stated = 0, mixed = 0, fine_mixed = 0, needless = 0;
  for (int i = 0; i < 600; ++i) {
    TriangleRecord t;
    t.material = static_cast<uint16_t>(random() % materials.size());
    const float size = i % 3 == 0 ? 0.02f : i % 3 == 1 ? 0.2f : 1.5f;
    const glm::vec2 at(8 * unit(random) - 4, 8 * unit(random) - 4);
    for (glm::vec2& uv : t.uvs) uv = at + size * glm::vec2(unit(random), unit(random));
    const TriangleMask mask = cut_outs->MaskAt(cut_outs->PlaceOf(t));
    REQUIRE(HoldsStates(mask.coarse));
    for (const uint32_t word : mask.fine.words) REQUIRE(HoldsStates(word));
    TexelStates found[kSubTriangles], fine_found[kFineSubTriangles], all;
    constexpr int kSteps = 120;
    for (int a = 0; a <= kSteps; ++a)
      for (int b = 0; a + b <= kSteps; ++b) {
        const float b1 = static_cast<float>(a) / kSteps, b2 = static_cast<float>(b) / kSteps;
        const TexelStates states = LookUp(image, t, materials[t.material].textures[0], b1, b2);
        found[SubTriangleOf<kMaskSteps>(b1, b2)].Meet(states);
        fine_found[SubTriangleOf<kFineMaskSteps>(b1, b2)].Meet(states);
        all.Meet(states);
      }
    CHECK(cut_outs->IsTransparent(t) == (mask.coarse == kTransparentMask));
    for (uint32_t sub = 0; sub < kSubTriangles; ++sub) {
      const OpacityState state = StateOf(mask.coarse, sub);
      if (state == OpacityState::kOpaque) REQUIRE(found[sub].opaque);
      if (state == OpacityState::kTransparent) REQUIRE(found[sub].transparent);
      stated += state != OpacityState::kMixed;
      mixed += state == OpacityState::kMixed;
      needless += state == OpacityState::kMixed && !found[sub].mixed();
    }
    for (uint32_t sub = 0; sub < kFineSubTriangles; ++sub) {
      const OpacityState state = StateOf(mask.fine.words[sub / 16], sub % 16);
      if (state == OpacityState::kOpaque) REQUIRE(fine_found[sub].opaque);
      if (state == OpacityState::kTransparent) REQUIRE(fine_found[sub].transparent);
      fine_mixed += state == OpacityState::kMixed;
    }
  }
  CHECK(fine_mixed < mixed * (kFineSubTriangles / kSubTriangles) / 2);  // of what coarse masks leave open
  CHECK(stated > 2000);
  CHECK(mixed > 500);
  CHECK(needless * 20 < mixed);  // texels between the sampled points, or within the slack
}

TEST_CASE("A texel that shading's rounding decides is neither opaque nor transparent", "[texture]") {
  const float texel = 128.0f / 255;
  CHECK(OpacityRule{1, texel + 1e-4f}.StatesOf(texel).transparent);
  CHECK(OpacityRule{1, texel + 5e-7f}.StatesOf(texel).mixed());
  CHECK(OpacityRule{1, texel}.StatesOf(texel).opaque);
  CHECK(OpacityRule{1, 0}.StatesOf(0).transparent);
  CHECK(OpacityRule{1, 0}.StatesOf(1).opaque);
}

TEST_CASE("Texels at borders of tiles and at far coordinates are classified correctly", "[texture]") {
  const test::TemporaryFolder folder;
  Grey image(200, 130, 1);
  std::ranges::fill(image.values, uint8_t{255});
  image.values[static_cast<size_t>(64 * 200 + 128)] = 0;  // the first texel of a tile
  image.Write(folder.file("g.pgm"));
  TextureBinding b;
  b.use = TextureUse::kOpacity;
  b.texture = 0;
  b.cutoff = 0.5f;
  Progress progress(true);
  const auto cut_outs = CutOuts::Read({Mapped(b), Material{}}, {ImageIn(folder.file("g.pgm"))}, Helper(),
                                      folder.file("tiles"), progress);
  REQUIRE(cut_outs);
  const auto mask_about = [&](float x, float y, float by) {
    TriangleRecord t;
    t.uvs[0] = {(x - by) / 200, (y - by) / 130};
    t.uvs[1] = {(x + 2 * by) / 200, (y - by) / 130};
    t.uvs[2] = {(x - by) / 200, (y + 2 * by) / 130};
    return cut_outs->MaskAt(cut_outs->PlaceOf(t)).coarse;
  };
  CHECK(mask_about(128.5f, 64.5f, 0.1f) == 0);
  for (const float far : {1.7f, -1.7f}) {
    CHECK(mask_about(128.5f + far, 64.5f, 0.1f) == kOpaqueMask);
    CHECK(mask_about(128.5f, 64.5f + far, 0.1f) == kOpaqueMask);
    CHECK(mask_about(128.5f + far / 2, 64.5f - far / 2, 0.05f) == 0);
  }
  CHECK(mask_about(128.5f + 200 * 3, 64.5f - 130 * 5, 0.1f) == 0);
  CHECK(mask_about(1e20f, 3, 1) == 0);
  CHECK(mask_about(std::nanf(""), 3, 1) == kOpaqueMask);  // as at (0, 0)
  CHECK_FALSE(cut_outs->IsMapped(1));
  CHECK_FALSE(cut_outs->failed());
}

TEST_CASE("An image that cannot be read, or has no alpha, cuts nothing out", "[texture]") {
  const test::TemporaryFolder folder;
  std::ofstream(folder.file("bad.pgm")) << "P5 5 5 255\nx";
  std::ofstream(folder.file("rgb.ppm")) << "P6 1 1 255\nabc";
  TextureBinding first, second;
  first.use = second.use = TextureUse::kOpacity;
  first.texture = 0;
  second.texture = 1;
  second.cutoff = 0.9f;
  TextureImage color = ImageIn(folder.file("rgb.ppm"));
  color.color = true;
  color.pick = TexturePick::kColorAndAlpha;
  Progress progress(true);
  const auto cut_outs =
      CutOuts::Read({Mapped(first), Mapped(second)}, {ImageIn(folder.file("bad.pgm")), color}, Helper(),
                    folder.file("tiles"), progress);
  REQUIRE(cut_outs);
  CHECK_FALSE(cut_outs->any());
  CHECK_FALSE((cut_outs->IsMapped(0) || cut_outs->IsMapped(1)));
}

}  // namespace quarry

#include <catch2/catch.hpp>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <random>
#include <set>

#include "common/engine/surfaces/texture_frame.h"
#include "common/engine/surfaces/texture_packet.h"
#include "common/math/elementary.h"
#include "common/math/half.h"

namespace quarry {
namespace {

constexpr TextureWrap kWraps[] = {TextureWrap::kRepeat, TextureWrap::kClamp, TextureWrap::kMirror};

/// A texture whose levels hold random texels, cut into pages, and lookups in its levels by the definition.
class RandomTexture {
 public:
  RandomTexture(uint32_t width, uint32_t height, uint32_t channels, TexelFormat format)
      : layout_{width, height, channels, format}, shape_(width, height) {
    std::mt19937 random(width * 7 + height + channels);
    for (const TextureShape::Level& level : shape_.levels()) {
      Bytes texels(size_t{level.width} * level.height * layout_.texel_bytes());
      for (size_t i = 0; i < texels.size(); ++i) texels[i] = static_cast<std::byte>(random());
      if (format == TexelFormat::kHalf)  // numbers between -2 and 2
        for (size_t i = 1; i < texels.size(); i += 2) texels[i] &= std::byte{0xBF};
      levels_.push_back(std::move(texels));
    }
    for (uint32_t p = 0; p < shape_.pages(); ++p) pages_.push_back(PageOf(p));
    catalog_.textures.push_back({"random", layout_, std::vector<BlockEntry>(shape_.pages())});
    catalog_.shapes.push_back(shape_);
    catalog_.first_page.push_back(shape_.pages());
    pyramid_.emplace(catalog_, 0);
  }

  const TexturePyramid& pyramid() const { return *pyramid_; }
  const std::byte* Page(BlockKey key) const { return pages_[catalog_.PageOf(key)].data(); }
  size_t page_bytes(BlockKey key) const { return pages_[catalog_.PageOf(key)].size(); }
  uint32_t levels() const { return static_cast<uint32_t>(levels_.size()); }
  uint32_t width(uint32_t level) const { return shape_.levels()[level].width; }
  uint32_t height(uint32_t level) const { return shape_.levels()[level].height; }

  /// A channel of a texel, as the format says.
  double Channel(uint32_t level, int64_t x, int64_t y, uint32_t channel) const {
    const size_t at =
        (static_cast<size_t>(y) * width(level) + static_cast<size_t>(x)) * layout_.channels + channel;
    if (layout_.format == TexelFormat::kHalf) {
      uint16_t half = 0;
      std::memcpy(&half, &levels_[level][2 * at], 2);
      return static_cast<double>(HalfToFloat(half));
    }
    const double code = static_cast<double>(levels_[level][at]) / 255;
    const bool alpha = layout_.has_alpha() && channel + 1 == layout_.channels;
    return layout_.format == TexelFormat::kSrgb8 && !alpha ? DecodeSrgb(code) : code;
  }
  glm::dvec4 Texel(uint32_t level, int64_t x, int64_t y) const {
    const uint32_t n = layout_.channels;
    glm::dvec4 v(0, 0, 0, 1);
    for (uint32_t c = 0; c < 3; ++c) v[static_cast<int>(c)] = Channel(level, x, y, n < 3 ? 0 : c);
    if (layout_.has_alpha()) v.w = Channel(level, x, y, n - 1);
    return v;
  }
  static int64_t Wrapped(int64_t i, int64_t size, TextureWrap wrap) {
    if (wrap == TextureWrap::kClamp) return std::clamp<int64_t>(i, 0, size - 1);
    const int64_t period = wrap == TextureWrap::kMirror ? 2 * size : size;
    const int64_t m = ((i % period) + period) % period;
    return m < size ? m : period - 1 - m;
  }
  glm::dvec4 Bilinear(uint32_t level, const glm::dvec2& st, TextureWrap s, TextureWrap t) const {
    const double x = st.x * width(level) - 0.5, y = st.y * height(level) - 0.5;
    const auto i = static_cast<int64_t>(std::floor(x)), j = static_cast<int64_t>(std::floor(y));
    glm::dvec4 sum(0);
    for (int64_t dy = 0; dy < 2; ++dy)
      for (int64_t dx = 0; dx < 2; ++dx) {
        const double fx = x - static_cast<double>(i), fy = y - static_cast<double>(j);
        sum += Texel(level, Wrapped(i + dx, width(level), s), Wrapped(j + dy, height(level), t)) *
               ((dx == 1 ? fx : 1 - fx) * (dy == 1 ? fy : 1 - fy));
      }
    return sum;
  }

 private:
  Bytes PageOf(uint32_t page) const {
    const TextureShape::Part part = shape_.PartOf(page);
    const size_t bytes = layout_.texel_bytes();
    Bytes texels;
    const auto append = [&](uint32_t level, uint32_t x, uint32_t y, uint32_t w, uint32_t h) {
      for (uint32_t row = y; row < y + h; ++row) {
        const std::byte* from = &levels_[level][(size_t{row} * width(level) + x) * bytes];
        texels.insert(texels.end(), from, from + w * bytes);
      }
    };
    if (page + 1 != shape_.pages()) {
      append(part.level, part.x, part.y, part.width, part.height);
      return texels;
    }
    for (uint32_t l = shape_.tail(); l < levels(); ++l) append(l, 0, 0, width(l), height(l));
    return texels;
  }

  TexelLayout layout_;
  TextureShape shape_;
  std::vector<Bytes> levels_, pages_;
  Catalog catalog_;
  std::optional<TexturePyramid> pyramid_;
};

/// The footprint of a lookup, by some lane of a packet.
FilterFootprint FootprintAt(const TexturePyramid& pyramid, TextureWrap wrap_s, TextureWrap wrap_t,
                            const glm::vec2& st, float lod) {
  static uint32_t lane = 0;
  lane = (lane + 1) % RayPacket::kRays;
  SurfaceTexture texture{{}, 0};
  texture.binding.wrap_s = wrap_s;
  texture.binding.wrap_t = wrap_t;
  FootprintPacket footprints;
  float u[RayPacket::kRays] = {}, v[RayPacket::kRays] = {}, lods[RayPacket::kRays] = {};
  u[lane] = st.x;
  v[lane] = st.y;
  lods[lane] = lod;
  MakeFootprints(texture, pyramid, u, v, lods, uint64_t{1} << lane, footprints);
  return footprints[static_cast<int>(lane)];
}

glm::vec4 LookUp(const RandomTexture& texture, const FilterFootprint& footprint) {
  TextureLookup lookup;
  BlockKey missing;
  REQUIRE(GoOnLookup<LookupKind::kValue>(
      texture.pyramid(), footprint, [&](BlockKey key) { return texture.Page(key); }, lookup, missing));
  return lookup.sum;
}

bool Near(const glm::vec4& seen, const glm::dvec4& right, double most) {
  for (int c = 0; c < 4; ++c)
    if (!(std::fabs(static_cast<double>(seen[c]) - right[c]) <= most)) return false;
  return true;
}

}  // namespace

TEST_CASE("At the centre of a texel a lookup gives the texel, to the last bit", "[texture]") {
  for (const TexelFormat format : {TexelFormat::kSrgb8, TexelFormat::kLinear8, TexelFormat::kHalf})
    for (const uint32_t channels : {1u, 2u, 3u, 4u}) {
      const RandomTexture texture(256, 128, channels, format);
      for (uint32_t y = 0; y < 128; ++y)
        for (uint32_t x = 0; x < 256; ++x)
          for (const TextureWrap wrap : kWraps) {
            const glm::vec2 st((static_cast<float>(x) + 0.5f) / 256, (static_cast<float>(y) + 0.5f) / 128);
            const glm::vec4 seen = LookUp(texture, FootprintAt(texture.pyramid(), wrap, wrap, st, -3));
            if (seen != glm::vec4(texture.Texel(0, x, y))) FAIL("texel " << x << ", " << y);
          }
    }
}

TEST_CASE("Lookups agree with bilinear interpolation of the levels, for every wrap and any size",
          "[texture]") {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> place(-4, 4), level(-1, 12);
  for (const auto& [width, height] :
       {std::pair{300u, 133u}, {64u, 64u}, {65u, 3u}, {1u, 1u}, {1u, 200u}, {512u, 96u}}) {
    const RandomTexture texture(width, height, 3, TexelFormat::kLinear8);
    const auto last = static_cast<float>(texture.levels() - 1);
    for (int n = 0; n < 20000; ++n) {
      const glm::vec2 st(place(random), place(random));
      const float lod = level(random), at = std::clamp(lod, 0.0f, last);
      const TextureWrap s = kWraps[random() % 3], t = kWraps[random() % 3];
      const auto low = static_cast<uint32_t>(at);
      const double share = static_cast<double>(at) - low;
      glm::dvec4 right = texture.Bilinear(low, st, s, t) * (1 - share);
      if (share > 0) right += texture.Bilinear(low + 1, st, s, t) * share;
      // Positions are floats: 512 texels a unit, 4 units off.
      if (!Near(LookUp(texture, FootprintAt(texture.pyramid(), s, t, st, lod)), right, 5e-4))
        FAIL(width << " x " << height << " at " << st.x << ", " << st.y << ", level " << lod);
    }
  }
}

TEST_CASE("A lookup with one page in memory at a time ends with the same bits", "[texture]") {
  const RandomTexture texture(300, 133, 4, TexelFormat::kSrgb8);
  std::mt19937 random(5);
  std::uniform_real_distribution<float> place(0, 1), level(-1, 5);
  size_t most = 0;
  for (int n = 0; n < 20000; ++n) {
    // Every other one beside the corner of four pages.
    glm::vec2 st(place(random), place(random));
    if (n % 2 == 0) st = {64.0f / 300 + place(random) / 1000, 64.0f / 133 + place(random) / 1000};
    const auto footprint =
        FootprintAt(texture.pyramid(), kWraps[n % 3], TextureWrap::kRepeat, st, level(random));
    const glm::vec4 right = LookUp(texture, footprint);
    TextureLookup lookup;
    BlockKey here = BlockKey::Hot(0), missing;
    std::set<BlockKey> brought;
    for (int tries = 0; !GoOnLookup<LookupKind::kValue>(
             texture.pyramid(), footprint,
             [&](BlockKey key) { return key == here ? texture.Page(key) : nullptr; }, lookup, missing);
         ++tries) {
      REQUIRE(tries < 8);
      brought.insert(missing);
      here = missing;  // and no other
    }
    most = std::max(most, brought.size());
    if (lookup.sum != right) FAIL("lookup " << n);
  }
  CHECK(most >= 5);
}

TEST_CASE("Positions that are not numbers, or far away, still give a texel", "[texture]") {
  const RandomTexture texture(300, 133, 1, TexelFormat::kLinear8);
  const float odd[] = {NAN, INFINITY, -INFINITY, 3e38f, -1e20f, 1e6f, -0.0f, 1, -1e-9f, 0.99999994f};
  for (const float s : odd)
    for (const float t : odd)
      for (const TextureWrap wrap : kWraps)
        for (const float lod : {-1e30f, 0.0f, 3.5f, 1e30f, -INFINITY, static_cast<float>(INFINITY), NAN}) {
          const auto footprint = FootprintAt(texture.pyramid(), wrap, wrap, {s, t}, lod);
          for (uint32_t k = 0; k < footprint.count; ++k) {
            const BilinearTexels& texels = footprint.levels[k];
            REQUIRE(texels.level < texture.levels());
            for (int i = 0; i < 2; ++i) {
              REQUIRE(texels.x[i] < texture.width(texels.level));
              REQUIRE(texels.y[i] < texture.height(texels.level));
            }
          }
          const float value = LookUp(texture, footprint).x;
          CHECK((value >= 0 && value <= 1.0001f));
        }
}

TEST_CASE("The slope of a lookup is the derivative of the interpolation", "[texture]") {
  const RandomTexture texture(64, 64, 1, TexelFormat::kLinear8);
  std::mt19937 random(6);
  std::uniform_real_distribution<double> place(0.1, 0.9);
  for (int n = 0; n < 1000; ++n) {
    const glm::dvec2 st(place(random), place(random));
    const double step = 1e-6;
    const auto at = [&](double ds, double dt) {
      return texture.Bilinear(0, st + glm::dvec2(ds, dt), kWraps[0], kWraps[0]).x;
    };
    const double fx = st.x * 64 - 0.5 - std::floor(st.x * 64 - 0.5),
                 fy = st.y * 64 - 0.5 - std::floor(st.y * 64 - 0.5);
    if (std::min({fx, fy, 1 - fx, 1 - fy}) < 1e-3) continue;  // the slope jumps there
    TextureLookup lookup;
    BlockKey missing;
    REQUIRE(GoOnLookup<LookupKind::kSlope>(
        texture.pyramid(), FootprintAt(texture.pyramid(), kWraps[0], kWraps[0], st, 0),
        [&](BlockKey key) { return texture.Page(key); }, lookup, missing));
    CHECK(static_cast<double>(lookup.sum.x) ==
          Approx((at(step, 0) - at(-step, 0)) / (2 * step)).margin(0.01));
    CHECK(static_cast<double>(lookup.sum.y) ==
          Approx((at(0, step) - at(0, -step)) / (2 * step)).margin(0.01));
  }
}

TEST_CASE("Texels summed for a packet have the bits of single lookups", "[texture]") {
  std::mt19937 random(8);
  std::uniform_real_distribution<float> place(-2, 3), level(-2, 9);
  const auto lookups = std::make_unique<TextureLookups>();
  const auto texels = std::make_unique<TexelPacket>();
  const auto footprints = std::make_unique<FootprintPacket>();
  for (const TexelFormat format : {TexelFormat::kSrgb8, TexelFormat::kLinear8})
    for (const uint32_t channels : {1u, 2u, 3u, 4u}) {
      const RandomTexture texture(300, 133, channels, format);
      for (int n = 0; n < 200; ++n) {
        const LookupKind kind = n % 2 == 0 ? LookupKind::kValue : LookupKind::kSlope;
        SurfaceTexture use{{}, 0.5f};
        use.binding.wrap_s = kWraps[random() % 3];
        use.binding.wrap_t = kWraps[random() % 3];
        use.binding.transform = {1.5f, 0.25f, 0.125f, -0.5f, 2, 0.75f};
        float u[RayPacket::kRays], v[RayPacket::kRays], lod[RayPacket::kRays];
        for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
          u[i] = place(random);
          v[i] = place(random);
          lod[i] = i % 4 == 0 ? std::floor(level(random)) + 0.5f : level(random);  // some of one level
          lookups->SetLookup(static_cast<int>(i), {});
        }
        const uint64_t lanes = n % 3 == 0 ? ~uint64_t{0} : uint64_t{random()} << 32 | random();
        MakeFootprints(use, texture.pyramid(), u, v, lod, lanes, *footprints);
        PlaceTexels(texture.pyramid(), *footprints, lanes, *texels);
        for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
          if ((lanes >> i & 1) == 0) continue;
          for (uint32_t k = 0; k < (footprints->share[i] > 0 ? 8 : 4); ++k) {
            const auto key = BlockKey::Page(texels->page[k][i]);
            texels->codes[k][i] =
                CodesAt(texture.Page(key), texture.page_bytes(key), texels->index[k][i], channels);
          }
        }
        SumTexels(texture.pyramid(), *footprints, *texels, kind, lanes, *lookups);
        for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
          TextureLookup right;
          BlockKey missing;
          const auto find = [&](BlockKey key) { return texture.Page(key); };
          const FilterFootprint footprint = (*footprints)[static_cast<int>(i)];
          if ((lanes >> i & 1) != 0 && kind == LookupKind::kValue)
            REQUIRE(GoOnLookup<LookupKind::kValue>(texture.pyramid(), footprint, find, right, missing));
          if ((lanes >> i & 1) != 0 && kind == LookupKind::kSlope)
            REQUIRE(GoOnLookup<LookupKind::kSlope>(texture.pyramid(), footprint, find, right, missing));
          const glm::vec4 sum = lookups->LookupOf(static_cast<int>(i)).sum;
          if (sum != right.sum) FAIL(channels << " channels, lane " << i);
        }
      }
    }
}

TEST_CASE("Frames of a packet have the bits of single ones", "[texture]") {
  std::mt19937 random(9);
  std::normal_distribution<float> normal;
  const auto vector = [&] { return glm::vec3(normal(random), normal(random), normal(random)); };
  const auto lookups = std::make_unique<TextureLookups>();
  const auto triangles = std::make_unique<TrianglePacket>();
  const auto attributes = std::make_unique<AttributePacket>();
  const auto surfaces = std::make_unique<SurfacePacket>();
  const auto rays = std::make_unique<RayPacket>();
  const uint64_t lanes = 0xF0F123456789ABCDull;
  for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) {
    for (int c = 0; c < 3; ++c) {
      triangles->at[c].Set(i, i % 7 == 0 ? glm::vec3(1) : vector());  // some without area
      attributes->normal[c].Set(i, Unit(vector()));
      attributes->u[c][i] = i % 5 == 0 ? 0.5f : normal(random);  // some where uv does not vary
      attributes->v[c][i] = normal(random);
    }
    surfaces->geometric_normal.Set(i, Unit(vector()));
    surfaces->view.Set(i, Unit(vector()));
    rays->hit_t[i] = std::fabs(normal(random));
    lookups->cone_width[i] = std::fabs(normal(random));
    lookups->cone_spread[i] = normal(random);
  }
  const TextureLookups before = *lookups;
  BeginTextureFrames(*triangles, *rays, lanes, *lookups);
  MakeTextureFrames(*attributes, *surfaces, lanes, *lookups);
  for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) {
    if ((lanes >> i & 1) == 0) {
      CHECK(lookups->cone_width[i] == before.cone_width[i]);
      continue;
    }
    const glm::vec3 e1 = triangles->at[1][i] - triangles->at[0][i],
                    e2 = triangles->at[2][i] - triangles->at[0][i];
    const float width = std::fabs(before.cone_width[i] + before.cone_spread[i] * rays->hit_t[i]);
    const auto uv = [&](int c) { return glm::vec2(attributes->u[c][i], attributes->v[c][i]); };
    const TextureFrame frame = FrameOf(e1, e2, uv(1) - uv(0), uv(2) - uv(0));
    const float cosine = std::fabs(glm::dot(surfaces->geometric_normal[i], surfaces->view[i]));
    CHECK(lookups->cone_width[i] == width);
    CHECK(lookups->by_u[i] == frame.by_u);
    CHECK(lookups->by_v[i] == frame.by_v);
    CHECK(lookups->lod[i] == LodOf(frame.uv_area, width, cosine));
    CHECK(lookups->bending[i] ==
          BendingOf(e1, e2, attributes->normal[0][i], attributes->normal[1][i], attributes->normal[2][i]));
  }
}

}  // namespace quarry

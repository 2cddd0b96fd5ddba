#include <catch2/catch.hpp>
#include <cmath>
#include <memory>
#include <random>

#include "common/engine/surfaces/scene_surfaces.h"
#include "common/engine/surfaces/texture_frame.h"
#include "common/engine/surfaces/texture_packet.h"
#include "common/scene/open_pbr.h"

namespace quarry {
namespace {

/// A catalog with one texture and these materials.
Catalog WithTexture(std::vector<Material> materials, uint32_t side = 256) {
  Catalog catalog;
  const TextureShape shape(side, side);
  catalog.textures.push_back(
      {"t", {side, side, 3, TexelFormat::kLinear8}, std::vector<BlockEntry>(shape.pages())});
  catalog.shapes.push_back(shape);
  catalog.first_page.push_back(shape.pages());
  catalog.materials = std::move(materials);
  return catalog;
}

TextureBinding Binding(TextureUse use) {
  TextureBinding binding;
  binding.use = use;
  binding.texture = 0;
  return binding;
}

/// A material of each form, by lot.
Material RandomMaterial(std::mt19937& random, bool open_pbr) {
  std::uniform_real_distribution<float> unit(0, 1);
  const auto color = [&] { return glm::vec3(unit(random), unit(random), unit(random)); };
  const auto sometimes = [&](float value) { return random() % 2 == 0 ? 0.0f : value; };
  Material m;
  if (open_pbr) {
    m.base_color = color();
    m.base_metalness = sometimes(unit(random));
    m.specular_roughness = unit(random);
    m.specular_weight = unit(random);
    m.transmission_weight = sometimes(unit(random));
    m.geometry_opacity = random() % 2 == 0 ? 1.0f : unit(random);
    DeriveWhitted(m, random() % 2 == 0);
  } else {
    const float opacity = random() % 2 == 0 ? 1.0f : 0.25f;
    m.diffuse = color() * opacity;
    m.specular = color();
    m.shininess = 100 * unit(random);
    m.transmittance = glm::vec3(1 - opacity);
    m.reflectance = random() % 2 == 0 ? color() * 0.3f : glm::vec3(0);
    DeriveOpenPbr(m);
  }
  return m;
}

bool Near(const glm::vec3& a, const glm::vec3& b, float most = 1e-5f) { return glm::length(a - b) <= most; }

/// The normal that a lookup of a normal or bump map gives, by the last lane of a packet.
glm::vec3 MapNormal(const SurfaceTexture& texture, const TexturePyramid& pyramid, const glm::vec4& sum,
                    const glm::vec3& by_u, const glm::vec3& by_v, const Surface& s) {
  constexpr int kLane = RayPacket::kRays - 1;
  const auto lookups = std::make_unique<TextureLookups>();
  const auto surfaces = std::make_unique<SurfacePacket>();
  lookups->by_u.Set(kLane, by_u);
  lookups->by_v.Set(kLane, by_v);
  lookups->SetLookup(kLane, {4, sum});
  surfaces->normal.Set(kLane, s.normal);
  surfaces->view.Set(kLane, s.view);
  surfaces->entering[kLane] = s.entering;
  MapNormals(texture, pyramid, *lookups, uint64_t{1} << kLane, *surfaces);
  return surfaces->normal[kLane];
}

/// The triangle (0,0,0), (1,0,0), (0,1,0), seen from above.
Surface Flat(const glm::vec3& view = {0, 0, 1}) {
  Surface s = SurfaceAt({0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 0.3f, 0.3f, -view);
  return s;
}

}  // namespace

TEST_CASE("A texture of the material's own values changes nothing", "[texture]") {
  std::mt19937 random(1);
  for (int n = 0; n < 2000; ++n) {
    Material m = RandomMaterial(random, n % 2 == 0);
    m.textures = {Binding(TextureUse::kDiffuse), Binding(TextureUse::kSpecular),
                  Binding(TextureUse::kEmission)};
    if (n % 2 == 0) m.textures.push_back(Binding(TextureUse::kMetalRoughness));
    const SceneSurfaces scene(WithTexture({m}));
    TextureValues values;
    values.base = n % 2 == 0 ? m.base_color : m.diffuse / m.geometry_opacity;
    values.specular = m.specular;
    values.emission = m.emission;
    values.roughness = m.specular_roughness;
    values.metalness = m.base_metalness;
    const SurfaceProperties p = scene.PropertiesAt(m, 0, scene.UsesOf(0), values);
    CHECK(Near(p.diffuse, m.diffuse));
    CHECK(Near(p.specular, m.specular));
    CHECK(Near(p.emission, m.emission));
    CHECK(Near(p.reflectance, m.reflectance));
    CHECK(Near(p.transmittance, m.transmittance));
    CHECK(Near(p.base_color, m.base_color));
    CHECK(p.shininess == m.shininess);
  }
}

TEST_CASE("Lookups in a frame end at the level where a texel is as wide as the cone", "[texture]") {
  Material m;
  m.textures = {Binding(TextureUse::kDiffuse)};
  m.textures[0].transform = {2, 0, 0, 0, 8, 0};  // 4 times as many texels a side in the mean
  const SceneSurfaces scene(WithTexture({m}));
  // uv covers a square of 10 units.
  const TextureFrame frame = FrameOf({10, 0, 0}, {0, 10, 0}, {1, 0}, {0, 1});
  CHECK(frame.uv_area == Approx(0.01f));
  CHECK(Near(frame.by_u, {10, 0, 0}));
  CHECK(Near(frame.by_v, {0, 10, 0}));
  const float size = scene.TexturesOf(0)[0].size_lod;
  CHECK(size == Approx(10));
  const float texel = 10.0f / 1024;
  CHECK(LodOf(frame.uv_area, texel, 1) + size == Approx(0).margin(1e-5));
  CHECK(LodOf(frame.uv_area, 8 * texel, 1) + size == Approx(3));
  CHECK(LodOf(frame.uv_area, texel, 0.25f) + size == Approx(2));  // seen at a slant
  CHECK(LodOf(0, texel, 1) < -100);                               // one texel for the whole triangle
}

TEST_CASE("The curvature of a sphere's triangles is one over its radius", "[texture]") {
  std::mt19937 random(2);
  std::normal_distribution<float> normal;
  for (int n = 0; n < 100; ++n) {
    const float radius = 0.5f + static_cast<float>(n);
    glm::vec3 normals[3];
    const glm::vec3 middle = Unit({normal(random), normal(random), normal(random)});
    for (glm::vec3& at : normals)
      at = Unit(middle + glm::vec3(normal(random), normal(random), normal(random)) * 0.1f);
    const glm::vec3 e1 = (normals[1] - normals[0]) * radius, e2 = (normals[2] - normals[0]) * radius;
    CHECK(BendingOf(e1, e2, normals[0], normals[1], normals[2]) == Approx(1 / radius));
  }
  const glm::vec3 same(0, 0, 1);
  CHECK(BendingOf({1, 0, 0}, {0, 1, 0}, same, same, same) == 0);
  CHECK(BendingOf({0, 0, 0}, {0, 0, 0}, same, same, same) == 0);
}

TEST_CASE("A normal map of one texel tilts the normal as a tilted plane would", "[texture]") {
  Material m;
  m.textures = {Binding(TextureUse::kNormal)};
  const SceneSurfaces scene(WithTexture({m}));
  const TexturePyramid& pyramid = scene.pyramid(scene.TexturesOf(0)[0]);
  // Of the plane z = slope.x * x + slope.y * y: the image's rows run down, so v up is against t.
  for (const glm::vec2 slope : {glm::vec2(0.2f, 0.1f), glm::vec2(-0.5f, 0.3f), glm::vec2(0, 0)}) {
    const glm::vec3 plane = Unit({-slope.x, -slope.y, 1});
    SurfaceTexture texture = scene.TexturesOf(0)[0];
    texture.binding.transform = {1, 0, 0, 0, -1, 1};  // as importers of OBJ turn v
    const glm::vec4 texel(plane * 0.5f + 0.5f, 1);
    CHECK(Near(MapNormal(texture, pyramid, texel, {3, 0, 0}, {0, 5, 0}, Flat()), plane));
    // From below, the same sheet bulges the other way.
    const Surface below = Flat({0, 0, -1});
    CHECK(Near(MapNormal(texture, pyramid, texel, {3, 0, 0}, {0, 5, 0}, below), -plane));
    // An image that lies across: s along y, t along x.
    texture.binding.transform = {0, 1, 0, 1, 0, 0};
    const glm::vec3 across = Unit({slope.y, -slope.x, 1});
    CHECK(Near(MapNormal(texture, pyramid, texel, {3, 0, 0}, {0, 5, 0}, Flat()), across));
    // Half the strength.
    texture.binding.transform = {1, 0, 0, 0, -1, 1};
    texture.binding.factor = glm::vec4(0.5f);
    const glm::vec3 half = Unit({-slope.x / 2, -slope.y / 2, 1});
    CHECK(Near(MapNormal(texture, pyramid, texel, {3, 0, 0}, {0, 5, 0}, Flat()), half, 1e-4f));
  }
}

TEST_CASE("A bump map tilts the normal by the slope of its heights", "[texture]") {
  Material m;
  m.textures = {Binding(TextureUse::kBump)};
  const SceneSurfaces scene(WithTexture({m}));
  const SurfaceTexture& texture = scene.TexturesOf(0)[0];
  const TexturePyramid& pyramid = scene.pyramid(texture);
  // Rises by a tenth of the range over the whole image along s, and falls by a fifth along t, which runs with
  // v.
  const glm::vec4 slope(0.1f, -0.2f, 0, 0);
  const float texels = kBumpTexels / 256;  // height of the full range over the image's side
  const glm::vec3 right = Unit({-0.1f * texels, 0.2f * texels, 1});
  CHECK(Near(MapNormal(texture, pyramid, slope, {4, 0, 0}, {0, 4, 0}, Flat()), right));
}

TEST_CASE("A mapped normal that faces away is turned toward the viewer", "[texture]") {
  Material m;
  m.textures = {Binding(TextureUse::kNormal)};
  const SceneSurfaces scene(WithTexture({m}));
  const SurfaceTexture& texture = scene.TexturesOf(0)[0];
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0, 1);
  for (int n = 0; n < 10000; ++n) {
    const Surface s = Flat(Unit({unit(random) - 0.5f, unit(random) - 0.5f, unit(random) - 0.5f}));
    const glm::vec3 mapped =
        MapNormal(texture, scene.pyramid(texture), {unit(random), unit(random), unit(random), 1},
                  {unit(random) - 0.5f, unit(random) - 0.5f, 0}, {unit(random) - 0.5f, 1, 0}, s);
    CHECK(glm::dot(mapped, s.view) > kLeastFacing / 3);
    CHECK(glm::length(mapped) == Approx(1));
  }
  // Without a frame, and with a texel that is no direction, the surface keeps its normal.
  CHECK(MapNormal(texture, scene.pyramid(texture), glm::vec4(0.9f), {}, {}, Flat()) == Flat().normal);
  const glm::vec4 none(NAN);
  CHECK(MapNormal(texture, scene.pyramid(texture), none, {1, 0, 0}, {0, 1, 0}, Flat()) == Flat().normal);
}

}  // namespace quarry

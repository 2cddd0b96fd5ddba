#include "common/engine/integrators/scatter_packet.h"

#include <catch2/catch.hpp>
#include <cstring>
#include <random>

#include "common/scene/camera.h"

namespace quarry {
namespace {

class Random {
 public:
  float operator()() { return static_cast<float>(engine_() >> 8) * 0x1p-23f - 1; }
  glm::vec3 Vector() {
    const float x = (*this)(), y = (*this)();
    return {x, y, (*this)()};
  }
  uint32_t Bits() { return static_cast<uint32_t>(engine_()); }

 private:
  std::mt19937 engine_{11};
};

bool SameBits(const glm::vec3& a, const glm::vec3& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

void CheckSame(const Surface& a, const Surface& b) {
  CHECK(SameBits(a.position, b.position));
  CHECK(SameBits(a.geometric_normal, b.geometric_normal));
  CHECK(SameBits(a.normal, b.normal));
  CHECK(SameBits(a.color, b.color));
  CHECK(SameBits(a.view, b.view));
  CHECK(a.uv == b.uv);
  CHECK(a.entering == b.entering);
}

/// Random triangles, attributes and hits; some triangles have no area, some vertices no normal.
struct Hits {
  TrianglePacket triangles;
  AttributePacket attributes;
  RayPacket rays;
  ShadingVertex vertices[3][RayPacket::kRays];
  SurfacePacket surfaces{};

  explicit Hits(Random& random) {
    for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) {
      Ray ray;
      ray.origin = random.Vector();
      ray.direction = Unit(random.Vector());
      ray.hit = {1, 0, (random() + 1) / 4, (random() + 1) / 4, 0, 0};
      rays.Set(static_cast<uint32_t>(i), ray);
      for (int c = 0; c < 3; ++c) {
        triangles.at[c].Set(i, i % 9 == 0 ? ray.origin : random.Vector());
        ShadingVertex& v = vertices[c][i];
        v = {i % 7 == 0 ? glm::vec3(0) : Unit(random.Vector()), {random(), random()}, random.Bits()};
        attributes.normal[c].Set(i, v.normal);
        attributes.u[c][i] = v.uv.x;
        attributes.v[c][i] = v.uv.y;
        attributes.color[c][i] = v.color;
      }
    }
  }
  /// One by one.
  Surface SurfaceOf(int i) const {
    const glm::vec3 direction(rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]);
    return SurfaceAt(triangles.at[0][i], triangles.at[1][i], triangles.at[2][i], rays.b1[i], rays.b2[i],
                     direction);
  }
  Surface WithAttributes(int i) const {
    Surface s = SurfaceOf(i);
    AddAttributes(vertices[0][i], vertices[1][i], vertices[2][i], rays.b1[i], rays.b2[i], s);
    return s;
  }
};

constexpr uint64_t kSome[] = {~uint64_t{0}, 0x0123456789ABCDEFull, 0x8000000000000001ull,
                              0x0000FF0000000010ull};

Material Shiny() {
  Material m;
  m.diffuse = {0.5f, 0.25f, 1};
  m.specular = {0.3f, 0.2f, 0.9f};
  m.base_color = {0.75f, 0.5f, 0.875f};
  m.emission = {0, 0.125f, 0};
  m.shininess = 37;
  return m;
}

}  // namespace

TEST_CASE("Samples shaded together have the same bits as samples shaded one by one, and no others change") {
  Random random;
  for (const uint64_t lanes : kSome) {
    Hits hits(random);
    for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) hits.surfaces.position.Set(i, glm::vec3(77));
    MakeSurfaces(hits.triangles, hits.rays, lanes, hits.surfaces);
    for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i)
      if ((lanes >> i & 1) != 0)
        CheckSame(hits.surfaces[i], hits.SurfaceOf(i));
      else
        CHECK(hits.surfaces.position[i] == glm::vec3(77));
    MakeSurfaces(hits.triangles, hits.rays, ~uint64_t{0}, hits.surfaces);
    AddAttributes(hits.attributes, hits.rays, lanes, hits.surfaces);
    for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i)
      CheckSame(hits.surfaces[i], (lanes >> i & 1) != 0 ? hits.WithAttributes(i) : hits.SurfaceOf(i));
  }
}

TEST_CASE("Light scattered together has the same bits as light scattered one by one") {
  Random random;
  Hits hits(random);
  MakeSurfaces(hits.triangles, hits.rays, ~uint64_t{0}, hits.surfaces);
  Material dull = Shiny();
  dull.specular = glm::vec3(0);
  Material unlit = dull;
  unlit.unlit = true;
  const Light sun{LightKind::kSun, Unit(glm::vec3(1, 2, 3)), {2, 3, 4}},
      point{LightKind::kPoint, {0.5f, 0, 1}, {5, 4, 3}};
  for (const uint64_t lanes : kSome)
    for (const Material& material : {Shiny(), dull, unlit}) {
      const ScatterProperties one = ScatterOf(material, lanes == kSome[1] ? BaseColor : DiffuseColor);
      ScatterPacket all{};
      SetScatter(one, lanes, all);
      for (const Light& light : {sun, point}) {
        LightPacket samples{};
        Vectors scattered{};
        Scatter(all, light, hits.surfaces, lanes, samples, scattered);
        RayPacket rays = hits.rays;
        LeaveSurfaces(hits.surfaces, samples.direction, samples.distance, 0.25f, lanes, rays);
        for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) {
          const auto lane = static_cast<uint32_t>(i);
          if ((lanes >> i & 1) == 0) {
            CHECK(SameBits(scattered[i], glm::vec3(0)));
            CHECK(rays.HitOf(lane).triangle == hits.rays.HitOf(lane).triangle);
            continue;
          }
          const Surface s = hits.surfaces[i];
          const LightSample sample = SampleLight(light, s.position);
          CHECK(SameBits(scattered[i], Scatter(one, s, sample)));
          Ray ray;
          ray.origin = LeaveSurface(s.position, s.geometric_normal, sample.direction, 0.25f);
          ray.direction = sample.direction;
          ray.t_max = sample.distance;
          RayPacket single;
          single.Set(lane, ray);
          for (int a = 0; a < 3; ++a) {
            CHECK(rays.origin[a][i] == single.origin[a][i]);
            CHECK(rays.direction[a][i] == single.direction[a][i]);
          }
          CHECK(rays.t[i] == 0);
          CHECK(rays.hit_t[i] == single.hit_t[i]);
          CHECK(rays.triangle[i] == kNoTriangle);
          CHECK(rays.chain[i] == 0);
        }
      }
      Vectors headlight{}, ambient{};
      Headlight(all, hits.surfaces, lanes, headlight);
      Ambient(all, {0.1f, 0.2f, 0.3f}, hits.surfaces, lanes, ambient);
      for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i) {
        const bool meant = (lanes >> i & 1) != 0;
        const Surface s = hits.surfaces[i];
        const glm::vec3 albedo = one.albedo * s.color, emitted = Emitted(one, s);
        CHECK(SameBits(headlight[i], meant ? albedo * Facing(s) + emitted : glm::vec3(0)));
        CHECK(SameBits(ambient[i], meant ? albedo * glm::vec3(0.1f, 0.2f, 0.3f) * AmbientFactor(s) + emitted
                                         : glm::vec3(0)));
      }
    }
}

TEST_CASE("Each material's samples are visited once") {
  SurfacePacket surfaces{};
  for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i)
    surfaces.material[i] = static_cast<uint32_t>(i * i % 5);
  uint64_t met = 0;
  std::vector<uint32_t> materials;
  ForEachMaterial(surfaces, 0xFFFFFFFF00FFFFFFull, [&](uint32_t material, uint64_t lanes) {
    materials.push_back(material);
    CHECK((met & lanes) == 0);
    met |= lanes;
    for (int i = 0; i < static_cast<int>(RayPacket::kRays); ++i)
      if ((lanes >> i & 1) != 0) CHECK(surfaces.material[i] == material);
  });
  CHECK(met == 0xFFFFFFFF00FFFFFFull);
  CHECK(materials == std::vector<uint32_t>{0, 1, 4});
}

TEST_CASE("Primary rays shot together equal rays shot one by one") {
  CameraSpec spec;
  spec.eye = {0, 0, 5};
  spec.at = {0.1, 0.2, 0};
  spec.up = {0, 1, 0};
  CameraSpec flat = spec;
  flat.ortho_height = 3;
  const Camera cameras[] = {{spec, 8, 8, glm::vec3(-1), glm::vec3(1)},
                            {spec, 8, 8, glm::vec3(-9), glm::vec3(9)},
                            {flat, 8, 8, glm::vec3(-1), glm::vec3(1)}};
  double x[PrimaryRays::kCount], y[PrimaryRays::kCount];
  for (int i = 0; i < PrimaryRays::kCount; ++i) {
    x[i] = i % 8 + 0.5;
    y[i] = i / 8 + 0.25;
  }
  for (const Camera& camera : cameras) {
    PrimaryRays rays;
    camera.Shoot(x, y, rays);
    for (int i = 0; i < PrimaryRays::kCount; ++i) {
      const PrimaryRay ray = camera.Shoot(x[i], y[i]);
      CHECK(SameBits(ray.origin, {rays.origin[0][i], rays.origin[1][i], rays.origin[2][i]}));
      CHECK(SameBits(ray.direction, {rays.direction[0][i], rays.direction[1][i], rays.direction[2][i]}));
      CHECK(ray.t_offset == rays.t_offset[i]);
      CHECK(ray.misses == (rays.misses[i] != 0));
    }
  }
}

}  // namespace quarry

// Scenes whose answers are known without tracing.
#include <numbers>

#include "tests/reference/scene_fixture.h"

namespace quarry::test {
namespace {

struct Sphere {
  std::vector<glm::vec3> vertices;
  std::vector<std::array<uint32_t, 3>> faces;
};

/// A closed sphere of radius 1 around `centre`, poles and all.
Sphere MakeSphere(const glm::vec3& centre, uint32_t rings, uint32_t segments) {
  Sphere s;
  for (uint32_t r = 0; r <= rings; ++r)
    for (uint32_t k = 0; k < segments; ++k) {
      const double a = std::numbers::pi * r / rings, b = 2 * std::numbers::pi * k / segments;
      s.vertices.push_back(centre +
                           glm::vec3(std::sin(a) * std::cos(b), std::sin(a) * std::sin(b), std::cos(a)));
      if (r == 0 || r == rings) s.vertices.back() = centre + glm::vec3(0, 0, r == 0 ? 1 : -1);
    }
  const auto index = [&](uint32_t r, uint32_t k) { return r * segments + k % segments; };
  for (uint32_t r = 0; r < rings; ++r)
    for (uint32_t k = 0; k < segments; ++k) {
      if (r > 0) s.faces.push_back({index(r, k), index(r + 1, k), index(r, k + 1)});
      if (r + 1 < rings) s.faces.push_back({index(r, k + 1), index(r + 1, k), index(r + 1, k + 1)});
    }
  return s;
}

void WriteObj(const std::string& path, const Sphere& s) {
  std::ofstream out(path);
  out.precision(9);
  for (const glm::vec3& p : s.vertices) out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
  for (const auto& f : s.faces) out << "f " << f[0] + 1 << ' ' << f[1] + 1 << ' ' << f[2] + 1 << '\n';
}

}  // namespace

TEST_CASE("No ray leaves a closed mesh, through vertices and edges least of all", "[reference]") {
  const TemporaryFolder folder;
  // Far from the origin, so that every coordinate is rounded.
  for (const glm::vec3 centre : {glm::vec3(0), glm::vec3(13.7f, -5.1f, 101.3f)}) {
    const Sphere sphere = MakeSphere(centre, 24, 48);
    WriteObj(folder.file("sphere.obj"), sphere);
    const LoadedScene scene(folder.file("sphere.obj"), 4096);
    std::mt19937 random(17);
    uint64_t lost = 0;
    double worst = 0;
    for (int i = 0; i < 150000; ++i) {
      const auto& f = sphere.faces[random() % sphere.faces.size()];
      const glm::vec3 &a = sphere.vertices[f[0]], &b = sphere.vertices[f[1]], &c = sphere.vertices[f[2]];
      const float u = Uniform(random, 0, 1), v = Uniform(random, 0, 1 - u);
      const glm::vec3 targets[] = {a, a * u + b * (1 - u), a * u + b * v + c * (1 - u - v)};
      Ray ray;
      ray.origin = centre + PointInBox(random, glm::vec3(-0.5f), glm::vec3(0.5f));
      ray.direction = Unit(targets[i % 3] - ray.origin);
      lost += !scene.TraceOne<false>(ray);
      const glm::dvec3 d(ray.direction), o = glm::dvec3(ray.origin) - glm::dvec3(centre);
      const double along = -(o.x * d.x + o.y * d.y + o.z * d.z);
      const double exact = along + std::sqrt(along * along - (o.x * o.x + o.y * o.y + o.z * o.z) + 1);
      worst = std::max(worst, std::fabs(exact - static_cast<double>(ray.hit.t)));
    }
    CHECK(lost == 0);
    CHECK(worst <
          0.02);  // the mesh lies within 1 - cos(7.5 degrees / 2 * sqrt 2) of the sphere, seen slantwise
  }
}

TEST_CASE("Distances to a box are exact", "[reference]") {
  const TemporaryFolder folder;
  std::ofstream(folder.file("box.obj"))
      << "v 0 0 0\nv 4 0 0\nv 4 2 0\nv 0 2 0\nv 0 0 1\nv 4 0 1\nv 4 2 1\nv 0 2 1\n"
         "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
  const LoadedScene scene(folder.file("box.obj"), 4096);
  const auto distance = [&](const glm::vec3& origin, const glm::vec3& direction) {
    Ray ray;
    ray.origin = origin;
    ray.direction = direction;
    scene.TraceOne<false>(ray);
    return ray.hit;
  };
  CHECK(distance({1, 1, 0.5f}, {1, 0, 0}).t == 3.0f);
  CHECK(distance({1, 1, 0.5f}, {-1, 0, 0}).t == 1.0f);
  CHECK(distance({1, 1, 0.25f}, {0, 0, 1}).t == 0.75f);
  CHECK(distance({1, 1, 0.5f}, {0, -1, 0}).t == 1.0f);
  CHECK(distance({1, 1, 0.5f}, {0, -1, 0}).triangle / 2 == 2);  // fan ids in file order
  CHECK(distance({2, 1, 0.5f}, {0.6f, 0.8f, 0}).t == Approx(1.25));
  // On the diagonal both triangles are hit at the same t: the lower id is the hit.
  CHECK(distance({2, 1, 0.5f}, {0, 0, -1}).triangle == 0);
}

}  // namespace quarry::test

// No ray passes between triangles that share an edge or a vertex: rays from inside closed meshes, aimed at
// their edges and vertices, through small voxels. QUARRY_TEST_WATERTIGHT_RAYS (default 3 million) sets how
// many.
#include <array>
#include <glm/geometric.hpp>
#include <map>

#include "scenes/shapes.h"
#include "tests/reference/scene_fixture.h"
#include "tests/support/skip.h"

namespace quarry::test {
namespace {

struct Mesh {
  std::vector<glm::vec3> vertices;
  std::vector<std::array<uint32_t, 3>> faces;
};

void WriteObj(const std::string& path, const Mesh& mesh) {
  std::ofstream out(path);
  out.precision(9);
  for (const glm::vec3& v : mesh.vertices) out << "v " << v.x << ' ' << v.y << ' ' << v.z << '\n';
  for (const auto& f : mesh.faces) out << "f " << f[0] + 1 << ' ' << f[1] + 1 << ' ' << f[2] + 1 << '\n';
}

/// A torus of slender triangles, off the origin so that every coordinate is rounded.
Mesh MakeTorus(uint32_t around, uint32_t along) {
  Mesh mesh;
  for (uint32_t i = 0; i < along; ++i)
    for (uint32_t k = 0; k < around; ++k) {
      const double a = 6.283185307179586 * i / along, b = 6.283185307179586 * k / around;
      const double r = 3 + std::cos(b);
      mesh.vertices.emplace_back(17.3 + r * std::cos(a), -4.1 + r * std::sin(a), 211.7 + std::sin(b));
      const uint32_t i1 = (i + 1) % along, k1 = (k + 1) % around;
      const uint32_t p = i * around + k, q = i1 * around + k, r1 = i1 * around + k1, s = i * around + k1;
      mesh.faces.push_back({p, q, r1});
      mesh.faces.push_back({p, r1, s});
    }
  return mesh;
}

/// An octahedron's faces divided in four `times` times, on the unit sphere.
Mesh MakeSphere(int times) {
  Mesh mesh;
  mesh.vertices = {{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
  mesh.faces = {{0, 2, 4}, {2, 1, 4}, {1, 3, 4}, {3, 0, 4}, {2, 0, 5}, {1, 2, 5}, {3, 1, 5}, {0, 3, 5}};
  for (int t = 0; t < times; ++t) {
    std::map<std::pair<uint32_t, uint32_t>, uint32_t> middles;
    const auto middle = [&](uint32_t a, uint32_t b) {
      const auto [it, fresh] =
          middles.try_emplace(std::minmax(a, b), static_cast<uint32_t>(mesh.vertices.size()));
      if (fresh) mesh.vertices.push_back(Unit(mesh.vertices[a] + mesh.vertices[b]));
      return it->second;
    };
    std::vector<std::array<uint32_t, 3>> faces;
    for (const auto& f : mesh.faces) {
      const uint32_t ab = middle(f[0], f[1]), bc = middle(f[1], f[2]), ca = middle(f[2], f[0]);
      faces.insert(faces.end(), {{f[0], ab, ca}, {f[1], bc, ab}, {f[2], ca, bc}, {ab, bc, ca}});
    }
    mesh.faces = std::move(faces);
  }
  return mesh;
}

/// A pipe as the procedural plant has them: slender, bent, capped, far from the origin.
Mesh MakePipe() {
  struct Collector : scenes::MeshReceiver {
    Mesh mesh;
    Status BeginPart(uint32_t, const std::string&) override { return {}; }
    Status AddPiece(const scenes::Mesh& piece, uint32_t) override {
      const auto base = static_cast<uint32_t>(mesh.vertices.size());
      for (const scenes::MeshVertex& v : piece.vertices) mesh.vertices.push_back(v.position);
      for (const scenes::MeshFace& f : piece.faces)
        mesh.faces.push_back({base + f.a, base + f.b, base + f.c});
      return {};
    }
  } collector;
  scenes::Builder builder(collector);
  builder.Part("pipe");
  scenes::TubeStyle style;
  style.radius = 0.35f;
  style.bend_radius = 1.05f;
  style.segments = 24;
  style.bend_steps = 8;
  style.leg_steps = 24;
  const std::array<glm::vec3, 6> points{glm::vec3(141.3f, 77.7f, 12.1f), {147.3f, 77.7f, 12.1f},
                                        {147.3f, 91.2f, 12.1f},          {147.3f, 91.2f, 18.9f},
                                        {139.9f, 96.3f, 18.9f},          {131.7f, 96.3f, 23.3f}};
  scenes::Tube(builder, points, style);
  builder.Finish();
  return std::move(collector.mesh);
}

/// Vertices at the same place made one; every hole closed by a fan about its middle.
Mesh Closed(const std::vector<StoredTriangle>& triangles) {
  Mesh mesh;
  std::map<std::array<float, 3>, uint32_t> known;
  for (const StoredTriangle& t : triangles) {
    std::array<uint32_t, 3> face{};
    for (size_t k = 0; k < 3; ++k) {
      const glm::vec3& p = t.vertices[k];
      const auto [it, fresh] =
          known.try_emplace({p.x, p.y, p.z}, static_cast<uint32_t>(mesh.vertices.size()));
      if (fresh) mesh.vertices.push_back(p);
      face[k] = it->second;
    }
    mesh.faces.push_back(face);
  }
  std::map<std::pair<uint32_t, uint32_t>, int> edges;
  for (const auto& f : mesh.faces)
    for (size_t k = 0; k < 3; ++k) ++edges[{f[k], f[(k + 1) % 3]}];
  std::multimap<uint32_t, uint32_t> rim;  // against the faces' direction
  for (const auto& [edge, count] : edges)
    if (edges.find({edge.second, edge.first}) == edges.end()) rim.emplace(edge.second, edge.first);
  while (!rim.empty()) {
    std::vector<uint32_t> loop{rim.begin()->first};
    for (auto it = rim.begin(); it != rim.end(); it = rim.find(loop.back())) {
      loop.push_back(it->second);
      rim.erase(it);
      if (loop.back() == loop.front()) break;
    }
    glm::vec3 sum(0);
    for (size_t i = 0; i + 1 < loop.size(); ++i) sum += mesh.vertices[loop[i]];
    const auto centre = static_cast<uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back(sum / static_cast<float>(loop.size() - 1));
    for (size_t i = 0; i + 1 < loop.size(); ++i) mesh.faces.push_back({loop[i], loop[i + 1], centre});
  }
  return mesh;
}

/// The solid angle under which the mesh is seen from `p`, in spheres: 1 inside, 0 outside (van Oosterom
/// 1983).
double Winding(const Mesh& mesh, const glm::dvec3& p) {
  double sum = 0;
  for (const auto& f : mesh.faces) {
    const glm::dvec3 a = glm::dvec3(mesh.vertices[f[0]]) - p, b = glm::dvec3(mesh.vertices[f[1]]) - p,
                     c = glm::dvec3(mesh.vertices[f[2]]) - p;
    const double la = glm::length(a), lb = glm::length(b), lc = glm::length(c);
    sum += 2 * std::atan2(glm::dot(a, glm::cross(b, c)),
                          la * lb * lc + glm::dot(a, b) * lc + glm::dot(b, c) * la + glm::dot(c, a) * lb);
  }
  return sum / 12.566370614359172;
}

void AimAtEdges(const std::string& name, const Mesh& mesh, uint32_t voxel_size) {
  const TemporaryFolder folder;
  WriteObj(folder.file("mesh.obj"), mesh);
  const LoadedScene scene(folder.file("mesh.obj"), voxel_size);
  const char* given = std::getenv("QUARRY_TEST_WATERTIGHT_RAYS");
  const uint64_t wanted = (given ? std::strtoull(given, nullptr, 10) : 3000000) / 4;
  std::mt19937 random(31);
  const SceneMeta& meta = scene.catalog().meta;
  std::vector<glm::vec3> inside;
  for (int tries = 0; inside.size() < 200 && tries < 40000; ++tries) {
    const glm::vec3 p = PointInBox(random, meta.bounds_lower, meta.bounds_upper);
    if (std::fabs(Winding(mesh, glm::dvec3(p))) > 0.99) inside.push_back(p);
  }
  REQUIRE(inside.size() > 20);
  constexpr size_t kPackets = 256;
  std::vector<RayPacket> packets(kPackets);
  const std::vector<uint64_t> active(kPackets, ~uint64_t{0});
  uint64_t rays = 0, lost = 0;
  for (bool together = false; rays < wanted; together = !together) {
    for (RayPacket& packet : packets) {
      // Half of the packets look from one point at one vertex's surroundings, as packets of a picture do.
      const glm::vec3 eye = inside[random() % inside.size()];
      size_t face = random() % mesh.faces.size();
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        if (!together) face = random() % mesh.faces.size();
        const auto& f = mesh.faces[face];
        const size_t k = random() % 3;
        const float u = random() % 3 == 0 ? 0 : Uniform(random, 0, 1);
        const glm::vec3 target = mesh.vertices[f[k]] * (1 - u) + mesh.vertices[f[(k + 1) % 3]] * u;
        Ray ray;
        ray.origin = together ? eye : inside[random() % inside.size()];
        ray.direction = Unit(target - ray.origin);
        packet.Set(i, ray);
      }
    }
    const SceneView& view = scene.resident().view();
    TraceRays(view.top(), view.finder(), packets.data(), active.data(), kPackets, false);
    for (const RayPacket& packet : packets)
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) lost += packet.triangle[i] == kNoTriangle;
    rays += kPackets * RayPacket::kRays;
  }
  WARN(name << ": " << mesh.faces.size() << " triangles, " << scene.voxels().size() << " voxels, " << rays
            << " rays at edges and vertices, " << lost << " lost");
  CHECK(lost == 0);
}

}  // namespace

TEST_CASE("No ray passes between triangles that share an edge", "[reference][watertight]") {
  AimAtEdges("sphere", MakeSphere(6), 4096);
  AimAtEdges("torus", MakeTorus(24, 700), 4096);
  AimAtEdges("pipe", MakePipe(), 4096);
  const std::string bunny = ScenesFolder() + "/bunny/bun_zipper.ply";
  if (!std::filesystem::exists(bunny)) {
    test::Skip("the bunny (the folder of real models is not there)");
    return;
  }
  AimAtEdges("bunny, its holes closed", Closed(LoadedScene(bunny, 256u << 10).triangles()), 8192);
}

}  // namespace quarry::test

// Against Embree 3 in robust mode: the same triangle, or the same t within 1e-5; every other ray is put in a
// class.
#include <embree3/rtcore.h>

#include <thread>

#include "tests/reference/scene_fixture.h"
#include "tests/support/skip.h"

namespace quarry::test {
namespace {

class EmbreeScene {
 public:
  explicit EmbreeScene(const std::vector<StoredTriangle>& triangles)
      : triangles_(triangles), device_(rtcNewDevice("threads=2")), scene_(rtcNewScene(device_)) {
    rtcSetSceneFlags(scene_, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry geometry = rtcNewGeometry(device_, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(rtcSetNewGeometryBuffer(
        geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, triangles.size() * 3));
    auto* indices = static_cast<uint32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles.size()));
    for (size_t i = 0; i < triangles.size() * 3; ++i) {
      std::memcpy(vertices + 3 * i, &triangles[i / 3].vertices[i % 3], 12);
      indices[i] = static_cast<uint32_t>(i);
    }
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(scene_);
  }
  ~EmbreeScene() {
    rtcReleaseScene(scene_);
    rtcReleaseDevice(device_);
  }

  struct Found {
    uint32_t triangle = kNoTriangle;
    float t = kInfinity, u = 0, v = 0;
  };
  Found Intersect(const Ray& ray) const {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    RTCRayHit r{};
    r.ray = {ray.origin.x,
             ray.origin.y,
             ray.origin.z,
             0,
             ray.direction.x,
             ray.direction.y,
             ray.direction.z,
             0,
             kInfinity,
             0xFFFFFFFF,
             0,
             0};
    r.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    rtcIntersect1(scene_, &context, &r);
    if (r.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return {triangles_[r.hit.primID].id, r.ray.tfar, r.hit.u, r.hit.v};
  }

 private:
  const std::vector<StoredTriangle>& triangles_;
  RTCDevice device_;
  RTCScene scene_;
};

struct Classes {
  uint64_t rays = 0, hits = 0, same_triangle = 0, edge_tie = 0, same_plane = 0, coplanar = 0, edge = 0,
           at_origin = 0, unexplained = 0, lost = 0;
  void Add(const Classes& o) {
    rays += o.rays;
    hits += o.hits;
    same_triangle += o.same_triangle;
    edge_tie += o.edge_tie;
    same_plane += o.same_plane;
    coplanar += o.coplanar;
    edge += o.edge;
    at_origin += o.at_origin;
    unexplained += o.unexplained;
    lost += o.lost;
  }
};

/// How far inside its triangle a hit lies, as the least barycentric weight.
float Inside(float u, float v) { return std::min({u, v, 1 - u - v}); }

void Classify(const EmbreeScene::Found& e, const Hit& q, float scale, Classes& c) {
  ++c.rays;
  const bool q_hit = q.triangle != kNoTriangle, e_hit = e.triangle != kNoTriangle;
  c.hits += e_hit;
  if (e.triangle == q.triangle) {
    ++c.same_triangle;
    return;
  }
  const float tolerance = 1e-5f;
  if (q_hit && e_hit && std::fabs(q.t - e.t) <= tolerance * std::max(q.t, e.t)) {
    // On an edge that both triangles have; or within both, which then lie on each other.
    ++(Inside(e.u, e.v) < 1e-4f || Inside(q.b1, q.b2) < 1e-4f ? c.edge_tie : c.same_plane);
    return;
  }
  // The nearer of the two hits is in doubt for the other program if it lies on an edge or where the ray
  // starts.
  const bool e_first = e_hit && (!q_hit || e.t < q.t);
  const float inside = e_first ? Inside(e.u, e.v) : Inside(q.b1, q.b2);
  const float t = e_first ? e.t : q.t;
  if (t < 2e-6f * scale) {
    ++c.at_origin;
  } else if (inside < 1e-6f) {
    ++c.edge;
  } else if (q_hit && e_hit && std::fabs(q.t - e.t) <= 1e-6f * scale) {
    ++c.coplanar;  // closer together than positions can tell apart
  } else if (e_first) {
    ++c.lost;
  } else {
    ++c.unexplained;
  }
}

Ray RandomRay(const SceneMeta& m, std::mt19937& random) {
  Ray ray;
  ray.origin = PointInBox(random, m.root_lower, m.root_upper);
  ray.direction = Unit(PointInBox(random, m.root_lower, m.root_upper) - ray.origin);
  return ray;
}

/// A primary ray from one of a few eyes on a sphere around the scene, moved to the box as Camera does.
Ray PrimaryRay(const SceneMeta& m, std::mt19937& random) {
  const glm::vec3 centre = (m.root_lower + m.root_upper) * 0.5f, half = (m.root_upper - m.root_lower) * 0.5f;
  static const glm::vec3 sides[] = {{1, 0.7f, 0.4f}, {-1, 0.2f, 0.6f}, {0.1f, -1, 0.3f}, {0.3f, 0.1f, 1}};
  const glm::vec3 eye = centre + Unit(sides[random() % 4]) * (std::max({half.x, half.y, half.z}) * 2.5f);
  const glm::vec3 target = PointInBox(random, m.root_lower, m.root_upper);
  Ray ray;
  ray.origin = eye;
  ray.direction = Unit(target - eye);
  float enter = 0, exit = kInfinity;
  const float lower[3] = {m.root_lower.x, m.root_lower.y, m.root_lower.z};
  const float upper[3] = {m.root_upper.x, m.root_upper.y, m.root_upper.z};
  ClipToBox(MakeRayFrame(ray), lower, upper, enter, exit);
  ray.origin = eye + ray.direction * enter;
  return ray;
}

void Compare(const std::string& name, const std::string& model, uint32_t rays) {
  const LoadedScene scene(model, 256u << 10);
  const EmbreeScene embree(scene.triangles());
  const SceneMeta& meta = scene.catalog().meta;
  const float scale = meta.padding * 0x1p19f;
  Classes parts[2];
  std::thread threads[2];
  for (unsigned k = 0; k < 2; ++k)
    threads[k] = std::thread([&, k] {
      std::mt19937 random(99 + k);
      for (uint32_t i = 0; i < rays / 2; ++i) {
        const Ray fresh = i % 2 ? RandomRay(meta, random) : PrimaryRay(meta, random);
        Ray ray = fresh;
        scene.TraceOne<false>(ray);
        Classify(embree.Intersect(fresh), ray.hit, scale, parts[k]);
      }
    });
  for (auto& thread : threads) thread.join();
  Classes c = parts[0];
  c.Add(parts[1]);
  WARN(name << ": " << c.rays << " rays, " << c.hits << " hits; same triangle " << c.same_triangle
            << ", same t: edge tie " << c.edge_tie << ", coplanar " << c.same_plane
            << "; within 1e-6 of an edge " << c.edge << ", coplanar to 1e-6 of the scene " << c.coplanar
            << ", where the ray starts " << c.at_origin << ", unexplained " << c.unexplained << ", lost "
            << c.lost);
  CHECK(c.lost == 0);
  CHECK(c.unexplained == 0);
  CHECK(c.hits > c.rays / 10);
}

}  // namespace

TEST_CASE("Embree in robust mode finds the same hits on real models", "[reference][embree]") {
  const std::string folder = ScenesFolder();
  for (const std::string name : {"bunny/bun_zipper.ply", "bart/scene_kitchen/kitchen.obj", "dragon"}) {
    std::string path = folder + "/" + name;
    if (name == "dragon" && !folder.empty())
      for (const auto& entry : std::filesystem::directory_iterator(path))
        if (entry.path().extension() == ".ply" && entry.file_size() > (4u << 20))
          path = entry.path().string();
    if (folder.empty() || !std::filesystem::is_regular_file(path)) {
      test::Skip(name + " (the folder of real models is not there)");
      continue;
    }
    Compare(name, path, 2500000);
  }
}

TEST_CASE("Embree in robust mode finds the same hits on the plant", "[reference][embree]") {
  const TemporaryFolder folder;
  Compare("plant 1 M", GenerateScene(folder, "plant", 1000000), 3000000);
}

}  // namespace quarry::test

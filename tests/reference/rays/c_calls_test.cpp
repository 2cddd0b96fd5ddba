// The calls of quarry.h against brute force over the same conversion (RayOfQuery), a million rays: t,
// triangle, uv, part, material and normal in each ask, for caches of one block and of all, with one thread
// and several.
#include <cmath>
#include <limits>
#include <thread>

#include "common/api/quarry.h"
#include "common/engine/sources/ray_list.h"
#include "tests/reference/reference_rays.h"

namespace quarry::test {
namespace {

constexpr size_t kRays = 1'000'000;
constexpr glm::dvec3 kFarOff(654321.25, 5123456.5, 101.75);
constexpr int kParts = 5;

/// Triangles in a box far from the origin: single ones, each of which stands there twice, and a net whose
/// triangles share edges and vertices.
void WriteModel(const TemporaryFolder& folder, std::mt19937& random) {
  std::ofstream(folder.file("m.mtl")) << "newmtl a\nnewmtl b\nnewmtl c\nTf 0.5 0.6 0.7\nNi 1.5\nillum 6\n";
  std::ofstream out(folder.file("m.obj"));
  out.precision(12);
  out << "mtllib m.mtl\n";
  const auto vertex = [&](const glm::vec3& p) {
    const glm::dvec3 far = glm::dvec3(p) + kFarOff;
    out << "v " << far.x << ' ' << far.y << ' ' << far.z << '\n';
  };
  constexpr int kSide = 9;
  out << "g net\nusemtl a\n";
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x)
      vertex({static_cast<float>(x) * 1.25f, static_cast<float>(y) * 1.25f, 2.0f + Uniform(random, 0, 1)});
  for (int y = 0; y + 1 < kSide; ++y)
    for (int x = 0; x + 1 < kSide; ++x) {
      const int at = y * kSide + x + 1;
      out << "f " << at << ' ' << at + 1 << ' ' << at + kSide << "\nf " << at + 1 << ' ' << at + kSide + 1
          << ' ' << at + kSide << '\n';
    }
  for (int i = 0; i < 90; ++i) {
    out << "g part" << i % kParts << "\nusemtl "
        << "abc"[i % 3] << '\n';
    const glm::vec3 at = PointInBox(random, {0, 0, 0}, {10, 10, 10});
    for (int c = 0; c < 3; ++c) vertex(at + PointInBox(random, glm::vec3(-1.5f), glm::vec3(1.5f)));
    out << "f -3 -2 -1\nf -3 -2 -1\n";
  }
}

struct Asked {
  std::vector<double> numbers;  ///< six a ray
  std::vector<double> tnear, tfar;
  std::vector<uint64_t> splits{0};
  std::vector<Hit> hits;
  std::vector<double> t;  ///< of hits, in lengths of the direction

  size_t count() const { return tnear.size(); }
  quarry_rays rays() const {
    quarry_rays r = QUARRY_RAYS_INIT;
    r.count = count();
    r.origins = numbers.data();
    r.directions = numbers.data() + 3;
    r.stride = 6 * sizeof(double);
    r.tnear = tnear.data();
    r.tfar = tfar.data();
    return r;
  }
};

/// All hits of a ray, in order.
std::vector<Hit> HitsOf(const LoadedScene& scene, const TracedRay& traced) {
  std::vector<Hit> hits;
  if (traced.misses) return hits;
  const auto frame = MakeRayFrame(traced.ray);
  for (const StoredTriangle& triangle : scene.triangles()) {
    Hit hit;
    TestTriangle(frame, triangle.vertices[0], triangle.vertices[1], triangle.vertices[2], triangle.id, hit);
    if (hit.triangle != kNoTriangle && hit.t < traced.ray.t_max &&
        Follows<ScalarLane>(hit.t, hit.triangle, traced.ray.after_t, traced.ray.after_id))
      hits.push_back(hit);
  }
  std::ranges::sort(
      hits, [](const Hit& a, const Hit& b) { return a.t != b.t ? a.t < b.t : a.triangle < b.triangle; });
  return hits;
}

/// Rays of all kinds of MakeRay() in the model's coordinates, some from far outside, some with ends.
Asked MakeRays(const LoadedScene& scene, unsigned seed, size_t count) {
  std::mt19937 random(seed);
  const SceneMeta& meta = scene.catalog().meta;
  Asked asked;
  for (size_t i = 0; i < count; ++i) {
    const Ray ray = MakeRay(scene, random);
    glm::dvec3 origin = glm::dvec3(ray.origin) + meta.offset, direction(ray.direction);
    if (i % 5 == 0) origin -= 1e4 * direction;
    direction *= 0.25 + static_cast<double>(i % 7);
    double begin = 0, end = std::numeric_limits<double>::infinity();
    if (i % 4 == 1) begin = 0.4;
    if (i % 4 >= 2) end = 1.5 + static_cast<double>(i % 3);
    // As quarry.h says: the offset is subtracted in double, and t counts lengths of the direction.
    const double unit =
        std::sqrt(direction.x * direction.x + direction.y * direction.y + direction.z * direction.z);
    const RayQuery query{origin - meta.offset, direction, unit * end, unit * begin};
    const TracedRay traced = RayOfQuery(query, meta);
    for (const Hit& hit : HitsOf(scene, traced)) {
      asked.hits.push_back(hit);
      asked.t.push_back((traced.start + static_cast<double>(hit.t)) / unit);
    }
    asked.splits.push_back(asked.hits.size());
    for (int a = 0; a < 3; ++a) asked.numbers.push_back(origin[a]);
    for (int a = 0; a < 3; ++a) asked.numbers.push_back(direction[a]);
    asked.tnear.push_back(begin);
    asked.tfar.push_back(end);
  }
  return asked;
}

/// The rays of several sets, one after the other.
Asked Joined(const std::vector<Asked>& sets) {
  Asked all;
  for (const Asked& set : sets) {
    const uint64_t before = all.hits.size();
    for (size_t i = 1; i < set.splits.size(); ++i) all.splits.push_back(before + set.splits[i]);
    const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
    append(all.numbers, set.numbers);
    append(all.tnear, set.tnear);
    append(all.tfar, set.tfar);
    append(all.hits, set.hits);
    append(all.t, set.t);
  }
  return all;
}

/// Arrays for hits.
struct Arrays {
  explicit Arrays(size_t n) : t(n), triangle(n), part(n), material(n), uv(2 * n), normal(3 * n) {}
  quarry_hits hits() {
    quarry_hits h = QUARRY_HITS_INIT;
    h.t = t.data();
    h.triangle = triangle.data();
    h.part = part.data();
    h.material = material.data();
    h.uv = uv.data();
    h.normal = normal.data();
    return h;
  }
  bool IsMiss(size_t i) const {
    return t[i] == std::numeric_limits<double>::infinity() && triangle[i] == QUARRY_NONE &&
           part[i] == QUARRY_NONE && material[i] == QUARRY_NONE;
  }
  /// Whether entry `i` is entry `k` of brute force.
  bool Is(size_t i, const LoadedScene& scene, const Asked& asked, size_t k) const {
    const Hit& hit = asked.hits[k];
    const StoredTriangle& stored = scene.triangles()[hit.triangle];
    const glm::dvec3 n =
        glm::normalize(glm::cross(glm::dvec3(stored.vertices[1]) - glm::dvec3(stored.vertices[0]),
                                  glm::dvec3(stored.vertices[2]) - glm::dvec3(stored.vertices[0])));
    const uint32_t net = 2 * 8 * 8, after = hit.triangle - net;
    const bool of_net = hit.triangle < net;
    return t[i] == asked.t[k] && triangle[i] == hit.triangle && uv[2 * i] == hit.b1 &&
           uv[2 * i + 1] == hit.b2 && part[i] == (of_net ? 0 : 1 + after / 2 % kParts) &&
           material[i] == (of_net ? 0 : after / 2 % 3) &&
           glm::dot(n, glm::dvec3(normal[3 * i], normal[3 * i + 1], normal[3 * i + 2])) > 0.9999;
  }

  std::vector<double> t;
  std::vector<uint32_t> triangle, part, material;
  std::vector<float> uv, normal;
};

/// Rays of all asks whose answers are not those of brute force.
size_t Differences(quarry_scene* scene, const LoadedScene& loaded, const Asked& asked) {
  const quarry_rays rays = asked.rays();
  const size_t count = asked.count();
  size_t differences = 0;
  Arrays nearest(count), all(asked.hits.size());
  const quarry_hits of_nearest = nearest.hits(), of_all = all.hits();
  std::vector<uint8_t> any(count);
  std::vector<uint32_t> counts(count);
  INFO(quarry_error());
  REQUIRE(quarry_nearest(scene, &rays, &of_nearest) == QUARRY_OK);
  REQUIRE(quarry_any(scene, &rays, any.data()) == QUARRY_OK);
  REQUIRE(quarry_count(scene, &rays, counts.data()) == QUARRY_OK);
  REQUIRE(quarry_all(scene, &rays, asked.splits.data(), &of_all) == QUARRY_OK);
  for (size_t i = 0; i < count; ++i) {
    const uint64_t first = asked.splits[i], end = asked.splits[i + 1];
    differences += first == end ? !nearest.IsMiss(i) : !nearest.Is(i, loaded, asked, first);
    differences += any[i] != (first < end ? 1 : 0);
    differences += counts[i] != end - first;
    for (uint64_t k = first; k < end; ++k) differences += !all.Is(k, loaded, asked, k);
  }
  return differences;
}

}  // namespace

TEST_CASE("A million rays of quarry.h have the hits of brute force, in each ask", "[reference][calls]") {
  const TemporaryFolder folder;
  std::mt19937 random(59);
  WriteModel(folder, random);
  const std::string store = folder.file("m.quarry");
  MakeStore({.models = {folder.file("m.obj")}, .output = store, .threads = 2, .voxel_size = 4096});
  const LoadedScene loaded(folder.file("m.obj"), 4096);
  REQUIRE(glm::length(loaded.catalog().meta.offset) > 1e5);
  REQUIRE(loaded.catalog().voxels.size() > 3);
  std::vector<Asked> sets(4);
  std::vector<std::thread> threads;
  for (unsigned i = 0; i < sets.size(); ++i)
    threads.emplace_back([&, i] { sets[i] = MakeRays(loaded, 100 + i, kRays / sets.size()); });
  for (std::thread& thread : threads) thread.join();
  const Asked asked = Joined(sets);
  REQUIRE(asked.count() == kRays);
  CHECK(asked.hits.size() > kRays);
  for (const uint64_t cache : {uint64_t{loaded.catalog().meta.largest_decoded}, uint64_t{64} << 20})
    for (const unsigned workers : {1u, 4u}) {
      quarry_options options = QUARRY_OPTIONS_INIT;
      options.cache_bytes = cache;
      options.threads = workers;
      quarry_scene* scene = nullptr;
      REQUIRE(quarry_open(store.c_str(), &options, &scene) == QUARRY_OK);
      INFO(cache << " bytes, " << workers << " threads");
      CHECK(Differences(scene, loaded, asked) == 0);
      CHECK(quarry_close(scene) == QUARRY_OK);
    }
}

}  // namespace quarry::test

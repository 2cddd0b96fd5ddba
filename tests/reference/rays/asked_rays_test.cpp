// AskRays() against brute force, in every ask: the hits are those of the rays that stand for the
// queries (RayOfQuery), whatever the cache and the threads.
#include "common/engine/ask_rays.h"
#include "common/engine/sources/ray_list.h"
#include "tests/reference/reference_rays.h"

namespace quarry::test {
namespace {

constexpr int kParts = 7;

/// Writes triangles in a box. Each stands there twice, so that hits at the same t have an order. Parts and
/// materials take turns; one material of three is glass.
void WriteModel(const TemporaryFolder& folder, std::mt19937& random) {
  std::ofstream(folder.file("m.mtl")) << "newmtl a\nnewmtl b\nnewmtl c\nTf 0.5 0.6 0.7\nNi 1.5\nillum 6\n";
  std::ofstream out(folder.file("m.obj"));
  out << "mtllib m.mtl\n";
  for (int i = 0; i < 900; ++i) {
    const glm::vec3 at = PointInBox(random, {0, 0, 0}, {10, 10, 10});
    out << "g part" << i % kParts << "\nusemtl "
        << "abc"[i % 3] << '\n';
    for (int c = 0; c < 3; ++c) {
      const glm::vec3 p = at + PointInBox(random, glm::vec3(-1), glm::vec3(1));
      out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
    }
    out << "f -3 -2 -1\nf -3 -2 -1\n";
  }
}

std::vector<Hit> ExpectedHits(const LoadedScene& scene, const TracedRay& traced) {
  std::vector<Hit> hits;
  if (traced.misses) return hits;
  Ray ray = traced.ray;
  while (true) {
    const Hit next = BruteForce(scene, ray);
    if (next.triangle == kNoTriangle) return hits;
    hits.push_back(next);
    ray.after_t = next.t;
    ray.after_id = next.triangle;
  }
}

struct Asked {
  std::vector<RayQuery> queries;
  std::vector<std::vector<Hit>> expected;
  size_t hits = 0;

  /// The same queries, with rays that pass glass.
  Asked PassingGlass(const LoadedScene& scene) const {
    Asked passing{queries, expected, 0};
    for (std::vector<Hit>& of_ray : passing.expected) {
      std::erase_if(of_ray, [&](const Hit& hit) { return scene.triangles()[hit.triangle].glass; });
      passing.hits += of_ray.size();
    }
    return passing;
  }
};

/// Queries of all kinds of MakeRay(), from outside too, of which some begin at a hit, behind one, or end at
/// one.
Asked MakeQueries(const LoadedScene& scene, std::mt19937& random, int count) {
  const SceneMeta& meta = scene.catalog().meta;
  Asked asked;
  for (int i = 0; i < count; ++i) {
    const Ray ray = MakeRay(scene, random);
    RayQuery query{glm::dvec3(ray.origin), glm::dvec3(ray.direction)};
    if (i % 5 == 0) query.origin -= 1e5 * query.direction;  // beyond the reach of kernels
    query.direction *= 0.25 + i % 7;
    std::vector<Hit> hits = ExpectedHits(scene, RayOfQuery(query, meta));
    if (!hits.empty() && i % 3 == 0) {
      const double start = RayOfQuery(query, meta).start;
      const double t = start + static_cast<double>(hits[hits.size() / 2].t);
      if (i % 2 == 0) query.begin = t;
      if (i % 4 < 2) query.end = i % 2 == 0 ? t * 1.5 : t;
      hits = ExpectedHits(scene, RayOfQuery(query, meta));
    }
    asked.queries.push_back(query);
    asked.hits += hits.size();
    asked.expected.push_back(std::move(hits));
  }
  return asked;
}

bool IsOf(const LoadedScene& scene, const Hit& hit, const HitSurface& surface) {
  const StoredTriangle& t = scene.triangles()[hit.triangle];
  const glm::dvec3 normal = glm::normalize(glm::cross(glm::dvec3(t.vertices[1]) - glm::dvec3(t.vertices[0]),
                                                      glm::dvec3(t.vertices[2]) - glm::dvec3(t.vertices[0])));
  const VoxelGeometry& voxel = scene.voxels()[hit.voxel];
  return glm::dot(normal, glm::dvec3(surface.normal)) > 0.9999 && surface.part == hit.triangle / 2 % kParts &&
         surface.material == voxel.materials[hit.local];
}

/// Rays whose answers are not those of brute force, in all asks.
size_t Differences(Renderer& renderer, const LoadedScene& scene, const Asked& asked, bool passes_glass) {
  const auto ask = [&](RayGoal goal, bool surfaces) {
    auto answers = AskRays(renderer, asked.queries,
                           {.goal = goal, .surfaces = surfaces, .rule = {.passes_glass = passes_glass}});
    REQUIRE(answers.has_value());
    return std::move(*answers);
  };
  const auto nearest = ask(RayGoal::kNearest, true), any = ask(RayGoal::kAny, false),
             counted = ask(RayGoal::kCount, false), all = ask(RayGoal::kAll, true);
  REQUIRE(all.hits.size() == asked.hits);
  REQUIRE(all.surfaces.size() == asked.hits);
  REQUIRE(counted.hits.empty());
  size_t differences = 0, next = 0;
  for (size_t i = 0; i < asked.queries.size(); ++i) {
    const std::vector<Hit>& expected = asked.expected[i];
    const Hit &near = nearest.hits[i], &some = any.hits[i];
    differences += expected.empty() ? near.triangle != kNoTriangle || some.triangle != kNoTriangle
                                    : !SameBits(near, expected[0]) || !IsOf(scene, near, nearest.surfaces[i]);
    differences += !expected.empty() && std::ranges::none_of(expected, [&](const Hit& hit) {
      return hit.triangle == some.triangle && hit.t == some.t;
    });
    differences += counted.counts[i] != expected.size() || all.counts[i] != expected.size();
    for (const Hit& hit : expected) {
      differences += !SameBits(all.hits[next], hit) || !IsOf(scene, all.hits[next], all.surfaces[next]);
      ++next;
    }
  }
  return differences;
}

}  // namespace

TEST_CASE("Asked rays have the hits of brute force, in every ask", "[reference][asked]") {
  const TemporaryFolder folder;
  std::mt19937 random(31);
  WriteModel(folder, random);
  const std::string store = folder.file("m.quarry");
  MakeStore({.models = {folder.file("m.obj")}, .output = store, .threads = 2, .voxel_size = 4096});
  const auto opened = Scene::Open(store);
  REQUIRE(opened.has_value());
  const LoadedScene scene(folder.file("m.obj"), 4096);
  const Asked asked = MakeQueries(scene, random, 3000);
  const Asked passing = asked.PassingGlass(scene);
  CHECK(asked.hits > 6000);
  CHECK(passing.hits < asked.hits * 3 / 4);
  for (const uint64_t cache : {uint64_t{opened->catalog().meta.largest_decoded}, uint64_t{64} << 20})
    for (const unsigned threads : {1u, 4u}) {
      const auto renderer = Renderer::Create(*opened, {cache, threads});
      REQUIRE(renderer.has_value());
      INFO(cache << " bytes, " << threads << " threads");
      CHECK(Differences(**renderer, scene, asked, false) == 0);
      CHECK(Differences(**renderer, scene, passing, true) == 0);
    }
}

}  // namespace quarry::test

// Rays go on after each hit to the next one in the order of (t, id), by every kernel: all hits of a ray, as
// brute force sorts them. Any-hit rays pass see-through triangles and note that they have met some. Holes
// that opacity masks know are no hits, nor are the triangles of hidden parts.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <utility>

#include "tests/laboratory/variants/all_kernels.h"
#include "tests/reference/reference_rays.h"

namespace quarry::test {
namespace {

using Hits = std::vector<Hit>;

bool Before(const Hit& a, const Hit& b) { return a.t < b.t || (a.t == b.t && a.triangle < b.triangle); }

/// All hits of a ray before its end, in order.
Hits AllHits(const LoadedScene& scene, const Ray& ray) {
  const auto frame = MakeRayFrame(ray);
  Hits hits;
  for (const StoredTriangle& t : scene.triangles()) {
    Hit hit;
    TestTriangle(frame, t.vertices[0], t.vertices[1], t.vertices[2], t.id, hit);
    if (hit.t < ray.t_max && !t.HasHoleAt(hit)) hits.push_back(hit);
  }
  std::sort(hits.begin(), hits.end(), Before);
  return hits;
}

/// Rays with all their hits.
struct Rays {
  std::vector<Ray> rays;  ///< whole packets
  std::vector<RayPacket> packets;
  std::vector<Hits> expected;
  uint64_t hits = 0;

  Rays(const LoadedScene& scene, uint32_t packet_count, uint32_t seed) {
    std::mt19937 random(seed);
    for (uint32_t i = 0; i < packet_count * RayPacket::kRays; ++i) rays.push_back(MakeRay(scene, random));
    std::stable_sort(rays.begin() + static_cast<std::ptrdiff_t>(rays.size() / 2), rays.end(),
                     [](const Ray& a, const Ray& b) { return ClassOf(a) < ClassOf(b); });
    packets.resize(packet_count);
    for (size_t i = 0; i < rays.size(); ++i) {
      expected.push_back(AllHits(scene, rays[i]));
      // Some rays end at a hit, which does not count, or just behind one.
      if (i % 4 < 2 && !expected[i].empty()) {
        const float t = expected[i][expected[i].size() / 2].t;
        rays[i].t_max = i % 4 == 0 ? t : NextAbove(t);
        std::erase_if(expected[i], [&](const Hit& hit) { return !(hit.t < rays[i].t_max); });
      }
      hits += expected[i].size();
      packets[i / RayPacket::kRays].Set(i % RayPacket::kRays, rays[i]);
    }
  }
};

/// Traces the rays that `active` names to their ends.
using Trace = std::function<void(std::vector<RayPacket>& packets, const std::vector<uint64_t>& active)>;

/// Goes through all hits of the rays of `active`; returns the hits of each ray.
std::vector<Hits> Peel(const Rays& rays, std::vector<RayPacket> packets, std::vector<uint64_t> active,
                       const Trace& trace) {
  std::vector<Hits> found(rays.rays.size());
  const auto going = [&] {
    return std::any_of(active.begin(), active.end(), [](uint64_t lanes) { return lanes != 0; });
  };
  while (going()) {
    trace(packets, active);
    for (size_t p = 0; p < packets.size(); ++p)
      for (uint64_t left = active[p]; left != 0; left &= left - 1) {
        const auto i = static_cast<uint32_t>(std::countr_zero(left));
        const size_t ray = p * RayPacket::kRays + i;
        // A ray that finds a hit again would never end.
        const Hit hit = packets[p].HitOf(i);
        if (hit.triangle == kNoTriangle || found[ray].size() > rays.expected[ray].size()) {
          active[p] &= ~(uint64_t{1} << i);
          continue;
        }
        found[ray].push_back(hit);
        packets[p].GoOnAfterHit(i, rays.rays[ray].t_max);
      }
  }
  return found;
}

/// Counts the rays whose hits are not those expected; tells the first.
class Comparison {
 public:
  Comparison(const LoadedScene& scene, std::string name)
      : voxels_(scene.resident().view().voxels()), name_(std::move(name)) {}

  void Compare(const std::vector<Hits>& expected, const std::vector<Hits>& found, const std::string& by) {
    for (size_t i = 0; i < found.size(); ++i) {
      const bool same = std::equal(expected[i].begin(), expected[i].end(), found[i].begin(), found[i].end(),
                                   [&](const Hit& a, const Hit& b) { return SameBits(a, b) && Placed(b); });
      if (same) continue;
      if (++differences < 5)
        UNSCOPED_INFO(name_ << " ray " << i << " by " << by << ": brute force finds " << expected[i].size()
                            << " hits, the kernel " << found[i].size());
    }
  }

  uint64_t differences = 0;

 private:
  bool Placed(const Hit& hit) const {
    return hit.voxel < voxels_.size() && voxels_[hit.voxel].triangle_ids[hit.local] == hit.triangle;
  }

  const std::vector<VoxelGeometry>& voxels_;
  std::string name_;
};

Trace Resident(const SceneView& view, TraceFunction trace) {
  return [&view, trace](std::vector<RayPacket>& packets, const std::vector<uint64_t>& active) {
    trace(view.top(), view.finder(), packets.data(), active.data(), static_cast<uint32_t>(packets.size()));
  };
}

Trace Suspending(const SceneView& view, std::vector<TraceFunction> traces, uint64_t& refused) {
  return [&view, traces, &refused](std::vector<RayPacket>& packets, const std::vector<uint64_t>& active) {
    const Suspensions suspended = TraceSuspending(view, traces, packets, active);
    CHECK(suspended.repeated == 0);
    refused += suspended.refused;
  };
}

/// Coherent rays by the kernel's function for them, then the others.
Trace Coherent(const SceneView& view, CoherentTraceFunction with, TraceFunction without) {
  return [&view, with, without](std::vector<RayPacket>& packets, const std::vector<uint64_t>& active) {
    std::vector<uint64_t> left = active;
    const auto count = static_cast<uint32_t>(packets.size());
    with(view.top(), view.finder(), packets.data(), left.data(), count);
    without(view.top(), view.finder(), packets.data(), left.data(), count);
  };
}

/// Every kernel and layout, all voxels there, or each absent at first.
void PeelAll(const LoadedScene& scene, uint32_t packets, const std::string& name) {
  const Rays rays(scene, packets, 77);
  const std::vector<uint64_t> all(packets, ~uint64_t{0});
  Comparison comparison(scene, name);
  uint64_t refused = 0;
  // A few rays of each half.
  std::vector<uint64_t> few(packets, 0);
  few.front() = few.back() = 0xFFFF00FF;
  std::vector<Hits> few_expected(rays.expected.size());
  for (size_t i = 0; i < few_expected.size(); ++i)
    if ((few[i / RayPacket::kRays] >> i % RayPacket::kRays & 1) != 0) few_expected[i] = rays.expected[i];

  std::vector<Hits> by_definition(rays.rays.size());
  for (size_t i = 0; i < rays.rays.size(); i += 7) {
    Ray ray = rays.rays[i];
    for (ray.hit = BruteForce(scene, ray); ray.hit.triangle != kNoTriangle;
         ray.hit = BruteForce(scene, ray)) {
      by_definition[i].push_back(ray.hit);
      ray.GoOnAfterHit();
    }
    CHECK(std::equal(by_definition[i].begin(), by_definition[i].end(), rays.expected[i].begin(),
                     rays.expected[i].end(), SameBits));
  }
  const SceneView& treelets = scene.resident().view();
  comparison.Compare(rays.expected, Peel(rays, rays.packets, all, Resident(treelets, ClosestByRule)),
                     "the rule");
  comparison.Compare(few_expected,
                     Peel(rays, rays.packets, few, Suspending(treelets, {ClosestByRule}, refused)),
                     "the rule, suspending");
  std::vector<TraceFunction> in_turn;
  for (const Variant& kernel : AllKernels()) {
    const SceneView& view = scene.resident().view(kernel.layout);
    const std::string by = kernel.name();
    comparison.Compare(rays.expected, Peel(rays, rays.packets, all, Resident(view, kernel.closest)), by);
    comparison.Compare(few_expected,
                       Peel(rays, rays.packets, few, Suspending(view, {kernel.closest}, refused)),
                       by + " suspending");
    if (kernel.layout == TreeLayout::kTreelets) in_turn.push_back(kernel.closest);
    if (!kernel.coherent_closest) continue;
    const auto rest = std::find_if(AllKernels().begin(), AllKernels().end(), [&](const Variant& other) {
      return other.isa == kernel.isa && other.grouping == "wide";
    });
    comparison.Compare(rays.expected,
                       Peel(rays, rays.packets, all, Coherent(view, kernel.coherent_closest, rest->closest)),
                       by + " for coherent rays");
  }
  comparison.Compare(few_expected, Peel(rays, rays.packets, few, Suspending(treelets, in_turn, refused)),
                     "kernels in turn");
  WARN(name << ": " << scene.triangles().size() << " triangles, " << scene.voxels().size() << " voxels, "
            << rays.rays.size() << " rays, " << rays.hits << " hits, " << AllKernels().size() << " kernels, "
            << refused << " voxels refused, " << comparison.differences << " differences");
  CHECK(comparison.differences == 0);
  CHECK(rays.hits > rays.rays.size() / 3);
}

/// Writes triangles to an OBJ file. Of each `period` triangles the first `clear` are glass. Triangles go by
/// turns to `parts` groups.
void WriteGlassSoup(const TemporaryFolder& folder, const std::string& path,
                    const std::vector<glm::vec3>& corners, size_t clear, size_t period, size_t parts = 1) {
  std::ofstream(folder.file("glass.mtl")) << "newmtl glass\nKd 0 0 0\nTf 0.5 0.6 0.7\nNi 1.5\nillum 6\n"
                                             "newmtl wall\nKd 0.5 0.5 0.5\n";
  std::ofstream out(path);
  out.precision(9);
  out << "mtllib glass.mtl\n";
  for (const glm::vec3& p : corners) out << "v " << p.x << ' ' << p.y << ' ' << p.z << '\n';
  for (size_t i = 0; i + 3 <= corners.size(); i += 3)
    out << "g part" << i / 3 % parts << "\nusemtl " << (i / 3 % period < clear ? "glass" : "wall") << "\nf "
        << i + 1 << ' ' << i + 2 << ' ' << i + 3 << '\n';
}

/// Squares on a lattice with distances of `step`: coplanar neighbours, vertices on every likely split plane.
std::vector<glm::vec3> Squares(std::mt19937& random, int count, float step) {
  std::vector<glm::vec3> corners;
  for (int i = 0; i < count; ++i) {
    const glm::vec3 p(static_cast<float>(random() % 8), static_cast<float>(random() % 8),
                      static_cast<float>(random() % 8));
    glm::vec3 e(0), f(0);
    e[i % 3] = 1;
    f[(i + 1) % 3] = 1;
    for (const glm::vec3& corner : {p, p + e, p + e + f, p, p + e + f, p + f})
      corners.push_back(corner * step);
  }
  return corners;
}

/// Every triangle again, in reverse order: two hits at each t.
std::vector<glm::vec3> Doubled(const std::vector<glm::vec3>& corners) {
  std::vector<glm::vec3> all = corners;
  for (size_t i = corners.size(); i >= 3; i -= 3)
    all.insert(all.end(), corners.begin() + static_cast<std::ptrdiff_t>(i - 3),
               corners.begin() + static_cast<std::ptrdiff_t>(i));
  return all;
}

/// Triangles that share a point, so that voxels overlap in chains.
std::vector<glm::vec3> Fan(std::mt19937& random, int count) {
  const auto point = [&] { return PointInBox(random, glm::vec3(-1), glm::vec3(1)); };
  std::vector<glm::vec3> corners;
  for (int i = 0; i < count; ++i)
    corners.insert(corners.end(), {glm::vec3(0.25f), glm::vec3(0.25f) + point(), glm::vec3(0.25f) + point()});
  return corners;
}

std::vector<glm::vec3> Slivers(std::mt19937& random, int count) {
  std::vector<glm::vec3> corners;
  for (int i = 0; i < count; ++i) {
    const glm::vec3 a = PointInBox(random, glm::vec3(-1), glm::vec3(1)),
                    b = PointInBox(random, glm::vec3(-1), glm::vec3(1));
    corners.insert(corners.end(),
                   {a, b, (a + b) * 0.5f + PointInBox(random, glm::vec3(-1e-5f), glm::vec3(1e-5f))});
  }
  return corners;
}

/// All planes across an axis that bound a cell.
std::vector<float> PlanesOf(const SceneView& view, uint32_t axis) {
  std::vector<float> planes;
  for (const VoxelGeometry& voxel : view.voxels())
    for (uint32_t n = 0; n < voxel.wide_count; ++n)
      for (const bool upper : {false, true})
        for (uint32_t i = 0; i < WideNode::kChildren; ++i) {
          const float plane = voxel.wide[n].bounds[WideNode::Face(axis, upper) + i];
          if (std::isfinite(plane)) planes.push_back(plane);
        }
  return planes;
}

/// Any-hit rays of every kernel end at opaque triangles, and at opaque parts of triangles, only. A ray that
/// has met others before its end finds them all when it starts again. Returns: the rays whose one see-through
/// hit was noted.
uint64_t CompareShadows(const LoadedScene& scene, uint32_t packets, const std::string& name) {
  const Rays rays(scene, packets, 78);
  std::vector<const StoredTriangle*> triangles(scene.catalog().meta.input_triangles);
  for (const StoredTriangle& t : scene.triangles()) triangles[t.id] = &t;
  const auto ends = [&](const Hit& hit) { return triangles[hit.triangle]->EndsRaysAt(hit); };
  const std::vector<uint64_t> all(packets, ~uint64_t{0});
  Comparison comparison(scene, name);
  uint64_t refused = 0, wrong = 0, dark = 0, tinted = 0, clear = 0, ones = 0;
  const auto compare = [&](const Trace& any, const Trace& closest, const std::string& by, bool notes) {
    std::vector<RayPacket> found = rays.packets;
    any(found, all);
    std::vector<uint64_t> again(packets, 0);
    std::vector<Hits> expected(rays.expected.size());
    for (size_t i = 0; i < rays.expected.size(); ++i) {
      RayPacket& packet = found[i / RayPacket::kRays];
      const auto lane = static_cast<uint32_t>(i % RayPacket::kRays);
      const Hits& hits = rays.expected[i];
      const bool occluded = std::any_of(hits.begin(), hits.end(), ends);
      const bool by_one_of_them = std::any_of(hits.begin(), hits.end(), [&](const Hit& hit) {
        return hit.triangle == packet.triangle[lane] && ends(hit);
      });
      const bool noted = (packet.see_through >> lane & 1) != 0;
      ++(occluded ? dark : hits.empty() ? clear : tinted);
      const bool one = (packet.one_see_through >> lane & 1) != 0;
      // A see-through hit without another is noted, so that the ray need not be traced again.
      const bool one_right =
          !one ? !notes || hits.size() != 1
               : (hits.size() == 1 && packet.noted_id[lane] == hits[0].triangle &&
                  packet.noted_t[lane] == hits[0].t && packet.b1[lane] == hits[0].b1 &&
                  packet.b2[lane] == hits[0].b2 &&
                  scene.voxels()[packet.voxel[lane]].triangle_ids[packet.local[lane]] == hits[0].triangle);
      const bool right = (packet.triangle[lane] != kNoTriangle) == occluded &&
                         (occluded ? by_one_of_them : noted == !hits.empty() && one_right);
      ones += !occluded && one ? 1 : 0;
      if (!right && ++wrong < 5)
        UNSCOPED_INFO(name << " shadow ray " << i << " by " << by << ": hits " << packet.triangle[lane]
                           << (noted ? ", has" : ", has not") << " met see-through triangles of "
                           << hits.size());
      if (occluded || !noted) continue;
      packet.StartAgain(lane);
      again[i / RayPacket::kRays] |= uint64_t{1} << lane;
      expected[i] = hits;
    }
    comparison.Compare(expected, Peel(rays, found, again, closest), by + ", started again");
  };
  const SceneView& treelets = scene.resident().view();
  compare(Resident(treelets, AnyByRule), Resident(treelets, ClosestByRule), "the rule", false);
  for (const Variant& kernel : AllKernels()) {
    const SceneView& view = scene.resident().view(kernel.layout);
    const std::string by = kernel.name();
    const bool notes = !kernel.of_gpu;  // RayPacket::one_see_through
    compare(Resident(view, kernel.any), Resident(view, kernel.closest), by, notes);
    if (kernel.isa == AllKernels().front().isa)
      compare(Suspending(view, {kernel.any}, refused), Resident(view, kernel.closest), by + " suspending",
              notes);
    if (!kernel.coherent_any) continue;
    const Kernel& rest = BestKernel(Grouping::kWide);
    compare(Coherent(view, kernel.coherent_any, rest.any),
            Coherent(view, kernel.coherent_closest, rest.closest), by + " for coherent rays", notes);
  }
  WARN(name << ": " << dark << " dark, " << tinted << " tinted, " << clear << " clear, " << refused
            << " voxels refused, " << wrong << " wrong, " << comparison.differences << " differences");
  CHECK(wrong == 0);
  CHECK(comparison.differences == 0);
  CHECK((dark > 0 && tinted > 0 && clear > 0));
  return ones;
}

}  // namespace

TEST_CASE("Rays that go on after each hit find all hits in order", "[reference][going_on]") {
  const TemporaryFolder folder;
  std::mt19937 random(9);
  const auto peel = [&](const std::string& name, const std::vector<glm::vec3>& corners) {
    const std::string path = folder.file(name + ".obj");
    WriteSoup(path, corners);
    const LoadedScene scene(path, 4096);
    PeelAll(scene, 24, name);
  };
  peel("squares", Doubled(Squares(random, 350, 1)));
  peel("uneven squares", Doubled(Squares(random, 350, 0.1f)));
  peel("fan", Doubled(Fan(random, 150)));
  peel("slivers", Doubled(Slivers(random, 300)));
  const std::vector<glm::vec3> one{{0, 0, 0}, {1, 0, 0}, {0, 1, 0.5f}};
  peel("single", Doubled(Doubled(one)));
  for (const std::string kind : {"plant", "forest"})
    PeelAll(LoadedScene(GenerateScene(folder, kind, 2000), 4096), 24, kind);
}

TEST_CASE("Any-hit rays pass see-through triangles and note it", "[reference][going_on]") {
  const TemporaryFolder folder;
  std::mt19937 random(10);
  const auto compare = [&](const std::string& name, const std::vector<glm::vec3>& corners, size_t clear,
                           size_t period) {
    const std::string path = folder.file(name + ".obj");
    WriteGlassSoup(folder, path, corners, clear, period);
    CompareShadows(LoadedScene(path, 4096), 24, name);
  };
  compare("squares", Doubled(Squares(random, 250, 0.1f)), 5, 6);
  compare("fan", Fan(random, 200), 9, 10);
  compare("slivers", Slivers(random, 300), 2, 3);
  // Long runs of glass: most voxels have only glass, or none.
  compare("halves", Squares(random, 250, 1), 150, 350);
}

TEST_CASE("Rays pass the holes of opacity masks, and end at opaque parts", "[reference][going_on]") {
  const TemporaryFolder folder;
  std::mt19937 random(12);
  // Every third triangle has no mask of its own; some are all mixed, some all holes, some name a fine mask.
  std::vector<FineMask> fine(7);
  for (FineMask& mask : fine)
    for (uint32_t& word : mask.words)
      for (uint32_t i = 0; i < 16; ++i) word = word << 2 | random() % 3;
  const MaskOf mask_of = [](uint32_t id) -> uint32_t {
    if (id % 3 == 0) return kOpaqueMask;
    if (id % 11 == 1) return 0;
    if (id % 17 == 1) return kTransparentMask;
    if (id % 2 == 1) return NameFineMask(id % 7);
    std::mt19937 states(id);
    uint32_t mask = 0;
    for (uint32_t i = 0; i < kSubTriangles; ++i) mask = mask << 2 | states() % 3;
    return mask;
  };
  const auto compare = [&](const std::string& name, const std::vector<glm::vec3>& corners, size_t clear,
                           size_t period) {
    const std::string path = folder.file(name + ".obj");
    WriteGlassSoup(folder, path, corners, clear, period);
    const LoadedScene scene(path, 4096, mask_of, {}, fine);
    PeelAll(scene, 24, name);
    CompareShadows(scene, 24, name);
  };
  compare("squares", Doubled(Squares(random, 250, 0.1f)), 1, 6);
  compare("fan", Fan(random, 200), 1, 10);
}

TEST_CASE("Triangles of hidden parts are no candidates to any ray", "[reference][going_on][parts]") {
  const TemporaryFolder folder;
  std::mt19937 random(13);
  const IsHidden is_hidden = [](uint32_t part) { return part % 3 == 1; };
  const MaskOf mask_of = [](uint32_t id) { return id % 5 == 0 ? 0u : kOpaqueMask; };
  const auto compare = [&](const std::string& name, const std::vector<glm::vec3>& corners,
                           const MaskOf& masks) {
    const std::string path = folder.file(name + ".obj");
    WriteGlassSoup(folder, path, corners, 5, 6, 7);
    const LoadedScene scene(path, 4096, masks, is_hidden);
    PeelAll(scene, 24, name);
    return CompareShadows(scene, 24, name);
  };
  compare("hidden squares", Doubled(Squares(random, 250, 0.1f)), {});
  compare("hidden fan", Fan(random, 300), {});
  CHECK(compare("hidden squares with holes", Squares(random, 400, 1), mask_of) > 0);
}

TEST_CASE("Packets skip no cell that only one of their rays grazes", "[reference][going_on]") {
  const TemporaryFolder folder;
  std::mt19937 random(11);
  const std::string path = folder.file("lattice.obj");
  WriteSoup(path, Squares(random, 700, 0.1f));
  const LoadedScene scene(path, 4096);
  const SceneView& view = scene.resident().view();
  const auto& meta = scene.catalog().meta;
  const std::vector<float> planes[3] = {PlanesOf(view, 0), PlanesOf(view, 1), PlanesOf(view, 2)};
  // Rays within planes between cells, or a few roundings beside them: alone in their packet, or with
  // neighbours along the plane.
  constexpr uint32_t kPackets = 1024;
  std::vector<RayPacket> packets(kPackets);
  std::vector<Hit> expected;
  uint64_t hits = 0;
  for (uint32_t p = 0; p < kPackets; ++p) {
    const auto axis = static_cast<int>(random() % 3), across = (axis + 1) % 3, along = (axis + 2) % 3;
    glm::vec3 origin = PointInBox(random, meta.bounds_lower, meta.bounds_upper);
    origin[axis] = meta.root_lower[axis] - Uniform(random, 0, 0.5f);
    origin[across] = planes[across][random() % planes[across].size()];
    for (uint32_t steps = random() % 3; steps > 0; --steps) origin[across] = NextAbove(origin[across]);
    glm::vec3 direction(0);
    direction[axis] = 1;
    if (random() % 2) direction[across] = Uniform(random, -1e-7f, 1e-7f);
    const float spread = random() % 2 ? 0.01f : 0;
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      Ray ray;
      ray.origin = origin;
      ray.origin[along] += spread * static_cast<float>(i);
      ray.direction = direction;
      packets[p].Set(i, ray);
      expected.push_back(BruteForce(scene, ray));
      hits += expected.back().triangle != kNoTriangle ? 1 : 0;
    }
  }
  for (const Variant& kernel : AllKernels()) {
    if (kernel.grouping != "wide packet") continue;
    std::vector<RayPacket> found = packets;
    TraceAll(view, kernel.closest, found);
    uint64_t differences = 0;
    for (size_t i = 0; i < expected.size(); ++i)
      differences += SameBits(found[i / RayPacket::kRays].HitOf(i % RayPacket::kRays), expected[i]) ? 0 : 1;
    INFO(kernel.isa << ", " << hits << " hits of " << expected.size() << " rays");
    CHECK(differences == 0);
  }
  CHECK(hits > expected.size() / 4);
}

}  // namespace quarry::test

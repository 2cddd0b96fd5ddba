// The hit that traversal finds is the hit by definition: least (t, id) over all triangles under the same
// test, to the last bit, through many tiny voxels, with every voxel absent at first.
#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <utility>

#include "common/kdtree/trace/stream_trace.h"
#include "tests/laboratory/variants/all_kernels.h"
#include "tests/reference/reference_rays.h"

namespace quarry::test {
namespace {

/// Every kernel and layout, all voxels there and each absent at first, closest hit and any hit.
void CompareAll(const LoadedScene& scene, uint32_t rays, const std::string& name) {
  std::mt19937 random(12345);
  const size_t count = rays / RayPacket::kRays;
  std::vector<RayPacket> closest(count), any(count);
  std::vector<Hit> expected;
  uint64_t hits = 0;
  std::vector<Ray> all;
  for (size_t i = 0; i < count * RayPacket::kRays; ++i) all.push_back(MakeRay(scene, random));
  // Half of them in packets of like direction.
  std::stable_sort(all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2), all.end(),
                   [](const Ray& a, const Ray& b) { return ClassOf(a) < ClassOf(b); });
  for (size_t i = 0; i < all.size(); ++i) {
    const Ray ray = all[i];
    expected.push_back(BruteForce(scene, ray));
    Ray shadow = ray;
    shadow.t_max =
        expected.back().triangle == kNoTriangle ? kInfinity : expected.back().t * (i % 2 ? 1.5f : 1.0f);
    closest[i / RayPacket::kRays].Set(i % RayPacket::kRays, ray);
    any[i / RayPacket::kRays].Set(i % RayPacket::kRays, shadow);
    hits += expected.back().triangle != kNoTriangle;
  }
  constexpr uint32_t kFew = 4;  // packets: few enough that some of their rays come to a voxel by themselves
  uint64_t differences = 0, together = 0, diverged = 0;
  Suspensions suspended;
  const auto& voxels = scene.resident().view().voxels();
  const auto compare = [&](const std::vector<RayPacket>& found, const std::vector<RayPacket>& occluded,
                           const std::string& by) {
    for (size_t i = 0; i < found.size() * RayPacket::kRays; ++i) {
      const auto lane = static_cast<uint32_t>(i % RayPacket::kRays);
      const Hit hit = found[i / RayPacket::kRays].HitOf(lane);
      const Hit shadow = occluded[i / RayPacket::kRays].HitOf(lane);
      const bool expect = expected[i].triangle != kNoTriangle && i % 2;
      const bool met =
          shadow.triangle != kNoTriangle || (occluded[i / RayPacket::kRays].see_through >> lane & 1) != 0;
      // Shading finds the triangle's other data by its voxel and its index there.
      const bool placed =
          hit.triangle == kNoTriangle ||
          (hit.voxel < voxels.size() && voxels[hit.voxel].triangle_ids[hit.local] == hit.triangle);
      if (placed && SameBits(hit, expected[i]) && met == expect) continue;
      if (++differences < 5)
        UNSCOPED_INFO(name << " ray " << i << " by " << by << ": brute force " << expected[i].triangle
                           << " at " << expected[i].t << ", kernel " << hit.triangle << " at " << hit.t
                           << (placed ? "" : ", but not by its place in the voxel") << ", occluded by "
                           << shadow.triangle << ", expected " << expect);
    }
  };
  // Suspended rays come again a dozen times each: a sixteenth of them.
  const auto part = static_cast<std::ptrdiff_t>((count + 15) / 16);
  {
    std::vector<RayPacket> found = closest, occluded = any;
    TraceAll(scene.resident().view(), ClosestByRule, found);
    TraceAll(scene.resident().view(), AnyByRule, occluded);
    compare(found, occluded, "the rule");
    found.assign(closest.end() - part, closest.end());
    occluded.assign(any.end() - part, any.end());
    const TraceFunction by_rule[2][2] = {{ClosestByRule, ClosestByRule}, {AnyByRule, AnyByRule}};
    suspended += TraceSuspending(scene.resident().view(), by_rule[0], found);
    suspended += TraceSuspending(scene.resident().view(), by_rule[1], occluded);
    // `compare` begins with the first ray.
    std::rotate(expected.begin(), expected.end() - part * RayPacket::kRays, expected.end());
    compare(found, occluded, "the rule, suspending");
    std::rotate(expected.begin(), expected.begin() + part * RayPacket::kRays, expected.end());
  }
  std::vector<TraceFunction> all_closest, all_any;
  for (const Variant& kernel : AllKernels()) {
    const SceneView& view = scene.resident().view(kernel.layout);
    const std::string by = kernel.name();
    std::vector<RayPacket> found = closest, occluded = any;
    TraceAll(view, kernel.closest, found);
    TraceAll(view, kernel.any, occluded);
    compare(found, occluded, by);
    found.assign(closest.begin(), closest.begin() + part);
    occluded.assign(any.begin(), any.begin() + part);
    suspended += TraceSuspending(view, kernel.closest, found);
    suspended += TraceSuspending(view, kernel.any, occluded);
    compare(found, occluded, by + " suspending");
    if (kernel.layout != TreeLayout::kTreelets) continue;
    all_closest.push_back(kernel.closest);
    all_any.push_back(kernel.any);
    if (!kernel.coherent_closest) continue;
    // Coherent rays by this kernel; the other rays go on from where they are by a kernel that takes all.
    const auto rest = std::find_if(AllKernels().begin(), AllKernels().end(), [&](const Variant& other) {
      return other.isa == kernel.isa && other.grouping == "wide";
    });
    found = closest;
    occluded = any;
    const auto go = [&](CoherentTraceFunction with, TraceFunction without, std::vector<RayPacket>& packets,
                        size_t first) {
      const auto n = static_cast<uint32_t>(std::min<size_t>(kFew, count - first));
      uint64_t left[kFew];
      std::fill_n(left, n, ~uint64_t{0});
      with(view.top(), view.finder(), packets.data() + first, left, n);
      for (uint32_t i = 0; i < n && kernel.grouping == "stream"; ++i)
        diverged += static_cast<uint64_t>(std::popcount(left[i]));
      without(view.top(), view.finder(), packets.data() + first, left, n);
    };
    for (size_t first = 0; first < count; first += kFew) {
      go(kernel.coherent_closest, rest->closest, found, first);
      go(kernel.coherent_any, rest->any, occluded, first);
    }
    if (kernel.grouping == "stream") together += 2 * all.size();
    compare(found, occluded, by + " for coherent rays");
  }
  // A ray that has waited may be gone on with by another kernel, in the voxel that it waited for.
  const SceneView& view = scene.resident().view();
  std::vector<RayPacket> found(closest.begin(), closest.begin() + part);
  std::vector<RayPacket> occluded(any.begin(), any.begin() + part);
  suspended += TraceSuspending(view, all_closest, found);
  suspended += TraceSuspending(view, all_any, occluded);
  compare(found, occluded, "kernels in turn");
  WARN(name << ": " << scene.triangles().size() << " triangles, " << scene.voxels().size() << " voxels, "
            << expected.size() << " rays, " << hits << " hits, " << AllKernels().size() << " kernels, "
            << suspended.refused << " voxels refused, " << diverged << " rays left streams of " << together
            << ", " << differences << " differences");
  CHECK(differences == 0);
  CHECK(suspended.repeated == 0);
  CHECK(diverged > 0);
  CHECK(diverged < together);
  CHECK(hits > expected.size() / 50);
}

}  // namespace

TEST_CASE("Traversal agrees with brute force to the last bit on generated scenes", "[reference]") {
  const TemporaryFolder folder;
  for (const std::string kind : {"cornell", "plant", "city", "forest", "stadium", "terrain"}) {
    const LoadedScene scene(GenerateScene(folder, kind, 2000), 4096);
    CHECK(scene.voxels().size() > 20);
    CompareAll(scene, 48000, kind);
  }
}

TEST_CASE("Traversal agrees with brute force on slivers, voxel chains and split planes", "[reference]") {
  const TemporaryFolder folder;
  std::mt19937 random(7);
  const auto point = [&](float size) { return PointInBox(random, glm::vec3(-size), glm::vec3(size)); };
  std::vector<glm::vec3> slivers, fan, boxes, bars;
  for (int i = 0; i < 700; ++i) {
    const glm::vec3 a = point(1), b = point(1);
    slivers.insert(slivers.end(), {a, b, a * 0.5f + b * 0.5f + point(1e-5f)});
    fan.insert(fan.end(), {glm::vec3(0.25f), glm::vec3(0.25f) + point(1), glm::vec3(0.25f) + point(1)});
    // Squares on a grid: coplanar neighbours, vertices on every likely split plane.
    const glm::vec3 p(static_cast<float>(random() % 8), static_cast<float>(random() % 8),
                      static_cast<float>(random() % 8));
    glm::vec3 e(0), f(0);
    e[i % 3] = 1;
    f[(i + 1) % 3] = 1;
    boxes.insert(boxes.end(), {p, p + e, p + e + f, p, p + e + f, p + f});
  }
  const auto compare = [&](const std::string& name, const std::vector<glm::vec3>& corners, uint32_t rays) {
    const std::string path = folder.file(name + ".obj");
    WriteSoup(path, corners);
    const LoadedScene scene(path, 4096);
    CompareAll(scene, rays, name);
    return scene.catalog();
  };
  compare("slivers", slivers, 32000);
  // Bars that cross: every plane cuts half of them.
  for (int i = 0; i < 240; ++i) {
    const glm::vec3 at(0.02f * static_cast<float>(i), 0, 0.001f * static_cast<float>(i % 7));
    const auto turned = [&](glm::vec3 p) { return i % 2 != 0 ? glm::vec3(p.y, p.x, p.z) : p; };
    for (const glm::vec3 side : {glm::vec3(0.008f, 0, 0), glm::vec3(0, 0, 0.05f)}) {
      const glm::vec3 a = turned(at), b = turned(at + side), c = turned(at + glm::vec3(0, 4.8f, 0)),
                      d = turned(at + side + glm::vec3(0, 4.8f, 0));
      bars.insert(bars.end(), {a, b, c, b, d, c});
    }
  }
  for (const auto& [name, corners] : {std::pair("fan", fan), std::pair("bars", bars)}) {
    const Catalog chained = compare(name, corners, 32000);
    CHECK(std::any_of(chained.voxels.begin(), chained.voxels.end(),
                      [](const VoxelEntry& v) { return v.next_in_chain != kNoIndex; }));
    CHECK(chained.meta.stored_references < chained.meta.input_triangles * 3 / 2);
  }
  compare("boxes", boxes, 32000);
  compare("single", {{0, 0, 0}, {1, 0, 0}, {0, 1, 0.5f}}, 16000);
}

TEST_CASE("Streams that most rays have left are skipped, and no hit changes", "[reference]") {
  const TemporaryFolder folder;
  const LoadedScene scene(GenerateScene(folder, "terrain", 400000), 4096);
  const SceneView& view = scene.resident().view();
  std::mt19937 random(5);
  constexpr uint32_t kStreams = 5;
  std::vector<RayPacket> rays(kStreams * kStreamPackets);
  for (RayPacket& packet : rays)
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) packet.Set(i, MakeRay(scene, random));
  {
    std::vector<RayPacket> first(rays.begin(), rays.begin() + kStreamPackets);
    std::vector<uint64_t> left(kStreamPackets, ~uint64_t{0});
    BestKernel(Grouping::kStream)
        .coherent_closest(view.top(), view.finder(), first.data(), left.data(), kStreamPackets);
    uint64_t count = 0;
    for (const uint64_t mask : left) count += static_cast<uint64_t>(std::popcount(mask));
    CHECK(count > uint64_t{kStreamPackets} * RayPacket::kRays * 3 / 4);
  }
  std::vector<RayPacket> by_rule = rays, single = rays;
  TraceAll(view, ClosestByRule, by_rule);
  TraceAll(view, BestKernel(Grouping::kWide).closest, single);
  uint64_t hits = 0, differences = 0;
  for (size_t p = 0; p < rays.size(); ++p)
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      hits += single[p].triangle[i] != kNoTriangle ? 1 : 0;
      differences += SameBits(by_rule[p].HitOf(i), single[p].HitOf(i)) ? 0 : 1;
    }
  CHECK(hits > rays.size() * RayPacket::kRays / 4);
  CHECK(differences == 0);
}

}  // namespace quarry::test

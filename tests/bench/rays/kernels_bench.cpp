// `quarry bench kernels`: the kernels against Embree, ray for ray, in one process on one core.
#include <fmt/format.h>
#include <sched.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <random>

#include "common/base/log.h"
#include "common/engine/blocks/loader.h"
#include "common/engine/blocks/pinned_blocks.h"
#include "common/program/run_program.h"
#include "tests/bench/arguments.h"
#include "tests/bench/figures.h"
#include "tests/bench/median.h"
#include "tests/bench/rays/embree_rays.h"
#include "tests/bench/rays/grazing.h"
#include "tests/bench/rays/one_level.h"
#include "tests/bench/rays/ray_order.h"
#include "tests/bench/rays/ray_sets.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/views.h"
#include "tests/laboratory/variants/all_kernels.h"

#ifndef NDEBUG
#error "benchmarks are built with the release preset"
#endif

namespace quarry::bench {
namespace {

struct Options {
  std::vector<std::string> stores;
  int repetitions = 5;
  uint64_t identical = 0;
  RayOrder order = RayOrder::kPixels;
  uint32_t size = 1024;
  std::string only, rays;
  bool one_level = false, interior = false, all = false, no_embree = false, robust_only = false,
       statistics = false;
  std::string json;
};

void PinToOneCore() {
  cpu_set_t set;
  CPU_ZERO(&set);
  CPU_SET(static_cast<size_t>(sched_getcpu()), &set);
  sched_setaffinity(0, sizeof set, &set);
}

/// The worker's cache with every hot block in it, as kernels reach it in a render.
class ResidentCache {
 public:
  static Result<std::unique_ptr<ResidentCache>> Load(const std::string& path) {
    QUARRY_ASSIGN(StoreReader store, StoreReader::Open(path));
    auto self = std::make_unique<ResidentCache>(std::move(store));
    const Catalog& catalog = self->store_.catalog();
    BlockDecoder decoder;
    for (uint32_t v = 0; v < catalog.voxels.size(); ++v) {
      const auto id = BlockKey::Hot(v);
      QUARRY_ASSIGN(const Bytes stored, self->store_.ReadBlock(id));
      auto block = std::make_unique<ResidentBlock>();
      block->bytes = *PageBuffer::TryGet(catalog.block(id).decoded);
      QUARRY_TRY(DecodeBlock(catalog, id, stored, decoder, *block, &self->trees_.emplace_back()));
      self->cache_.Reserve(id);
      self->cache_.Publish(id, std::move(block));
    }
    return self;
  }
  explicit ResidentCache(StoreReader store)
      : store_(std::move(store)),
        cache_(
            store_.catalog(), uint64_t{1} << 40, [] {}, [] {}),
        pins_(cache_) {
    pins_.LogTo(touched_, pins_.NewReader());
  }

  TopTree top() const { return store_.catalog().top_tree(); }
  VoxelFinder finder() { return pins_.finder(); }

 private:
  StoreReader store_;
  std::vector<std::vector<KdNode>> trees_;  ///< for kernels that no render uses
  VoxelCache cache_;
  std::vector<BlockKey> touched_;  ///< the blocks that pins_ notes, as in a render
  PinnedBlocks pins_;
};

/// One way to trace a set of rays.
struct Contender {
  std::string name;
  std::function<double()> run;  ///< seconds
  std::vector<double> times;
};

/// Rays by how Quarry's hit compares with Embree's. same: the same triangle. tie: two triangles at the same
/// t, but for rounding. grazing: one of the two misses a triangle whose border the ray passes too closely for
/// single precision. other: none of these.
struct Check {
  uint64_t same = 0, tie = 0, grazing = 0, other = 0;
};

/// Whether the ray grazes the nearer of the triangles hit, which the other program has not seen.
bool GrazesNearer(const test::ResidentScene& scene, const RayPacket& rays, uint32_t i, const Hit& a,
                  const Hit& b) {
  const uint32_t id =
      a.triangle != kNoTriangle && !(b.triangle != kNoTriangle && b.t < a.t) ? a.triangle : b.triangle;
  Ray ray;
  for (int axis = 0; axis < 3; ++axis) {
    ray.origin[axis] = rays.origin[axis][i];
    ray.direction[axis] = rays.direction[axis][i];
  }
  for (const VoxelGeometry& v : scene.voxels())
    for (uint32_t t = 0; t < v.triangle_count; ++t)
      if (v.triangle_ids[t] == id) return Grazes(ray, {v.vertex(t, 0), v.vertex(t, 1), v.vertex(t, 2)});
  return false;
}

/// Whether the kernel has the widest vectors of its grouping, over treelets, and is made for CPUs. `kernel`:
/// of AllKernels().
bool IsBest(const Variant& kernel) {
  return !kernel.of_gpu && &kernel == &*std::ranges::find_if(AllKernels(), [&](const Variant& other) {
    return other.grouping == kernel.grouping && other.layout == test::TreeLayout::kTreelets;
  });
}

/// Embree does not name the triangle that stops a shadow ray: a hit of Embree alone cannot be explained.
bool MayGraze(const test::ResidentScene& scene, const RaySet& set, size_t packet, uint32_t i,
              const Hit& embree, const Hit& quarry) {
  if (set.any && quarry.triangle == kNoTriangle) return false;
  return GrazesNearer(scene, set.packets[packet], i, set.any ? Hit{} : embree, quarry);
}

Check Compare(const test::ResidentScene& scene, const RaySet& set, const std::vector<RayPacket>& found,
              const EmbreeRays& embree) {
  Check c;
  size_t index = 0;
  for (size_t p = 0; p < found.size(); ++p)
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      if ((set.active[p] >> i & 1) == 0) continue;
      const Hit e = embree.Result(index++), q = found[p].HitOf(i);
      // Embree's shadow rays end at see-through triangles too.
      const bool met = q.triangle != kNoTriangle || (found[p].see_through >> i & 1) != 0;
      if (set.any ? (e.triangle != kNoTriangle) == met : e.triangle == q.triangle)
        ++c.same;
      else if (!set.any && std::fabs(e.t - q.t) <= 1e-5f * std::max(e.t, q.t))
        ++c.tie;
      else
        ++(MayGraze(scene, set, p, i, e, q) ? c.grazing : c.other);
    }
  return c;
}

class SceneBench {
 public:
  SceneBench(const Options& options, std::string name) : options_(options), name_(std::move(name)) {}

  Status Run(const std::string& path, nlohmann::json& results) {
    QUARRY_ASSIGN(scene_, test::ResidentScene::Load(path));
    if (options_.identical > 0) return CompareKernels();
    QUARRY_ASSIGN(cache_, ResidentCache::Load(path));
    QUARRY_ASSIGN(const CameraSpec view, FindView(path, scene_->catalog().meta, options_.interior));
    sets_ = MakeRaySets(*scene_, options_.size, view);
    for (RaySet& set : sets_) Reorder(set, options_.order, scene_->catalog().meta);
    if (!options_.no_embree) {
      if (!options_.robust_only) fast_ = std::make_unique<EmbreeRays>(*scene_, false);
      robust_ = std::make_unique<EmbreeRays>(*scene_, true);
    }
    if (options_.one_level) one_level_ = std::make_unique<OneLevelScene>(*scene_);
    PinToOneCore();
    Print(fmt::format("{}: {} triangles, {} voxels, {:.1f} bytes a triangle decoded, replication {:.2f}\n",
                      name_, scene_->catalog().meta.input_triangles, scene_->voxels().size(),
                      static_cast<double>(scene_->decoded_bytes()) /
                          static_cast<double>(scene_->catalog().meta.input_triangles),
                      static_cast<double>(scene_->catalog().meta.stored_references) /
                          static_cast<double>(scene_->catalog().meta.input_triangles)));
    for (const RaySet& set : sets_) Measure(set, results);
    if (others_ != 0)
      return Fail(
          fmt::format("{}: {} hits differ from Embree's, and their rays graze nothing", name_, others_));
    return {};
  }

 private:
  void AddKernel(const RaySet& set, const Variant& kernel, std::vector<Contender>& contenders) {
    const bool engine = kernel.layout == test::TreeLayout::kTreelets;
    const SceneView* view = engine ? nullptr : &scene_->view(kernel.layout);
    const TraceFunction trace = set.any ? kernel.any : kernel.closest;
    contenders.push_back({kernel.name(),
                          [this, &set, trace, view] {
                            found_ = set.packets;
                            const TopTree top = view ? view->top() : cache_->top();
                            const VoxelFinder finder = view ? view->finder() : cache_->finder();
                            const auto start = Clock::now();
                            trace(top, finder, found_.data(), set.active.data(),
                                  static_cast<uint32_t>(found_.size()));
                            return SecondsSince(start);
                          },
                          {}});
  }

  void Measure(const RaySet& set, nlohmann::json& results) {
    if (set.rays == 0 || (!options_.rays.empty() && options_.rays != set.name)) return;
    std::vector<Contender> contenders;
    contenders.push_back({"engine",
                          [this, &set] {
                            found_ = set.packets;
                            const auto start = Clock::now();
                            TraceRays(cache_->top(), cache_->finder(), found_.data(), set.active.data(),
                                      static_cast<uint32_t>(found_.size()), set.any);
                            return SecondsSince(start);
                          },
                          {}});
    for (const Variant& kernel : AllKernels()) {
      const bool best = IsBest(kernel);
      if (!options_.only.empty() && kernel.name().find(options_.only) == std::string::npos) continue;
      if (best || options_.all) AddKernel(set, kernel, contenders);
    }
    const size_t first_one_level = contenders.size();
    if (one_level_)
      for (Grouping grouping : {Grouping::kWidePacket, Grouping::kStream})
        contenders.push_back({fmt::format("one level {}", NameOf(grouping)),
                              [this, &set, grouping] {
                                found_ = set.packets;
                                const auto start = Clock::now();
                                one_level_->Trace(found_.data(), set.active.data(),
                                                  static_cast<uint32_t>(found_.size()), grouping, set.any);
                                return SecondsSince(start);
                              },
                              {}});
    const size_t ours = contenders.size();
    for (auto [embree, kind] : {std::pair{fast_.get(), "embree"}, {robust_.get(), "embree robust"}}) {
      if (!embree) continue;
      embree->SetRays(set.packets, set.active, set.any, set.coherent);
      const std::pair<EmbreeMode, const char*> modes[] = {
          {EmbreeMode::kSingle, "single"}, {EmbreeMode::kPacket, "packet"}, {EmbreeMode::kStream, "stream"}};
      for (auto [mode, mode_name] : modes)
        contenders.push_back({fmt::format("{} {}", kind, mode_name),
                              [embree = embree, mode = mode] { return embree->Trace(mode); },
                              {}});
    }
    // Each once before it is timed: else some would find their data in the cache, left there by another mode
    // over the same tree, and others would not.
    for (int r = 0; r < options_.repetitions; ++r)
      for (Contender& c : contenders) {
        c.run();
        c.times.push_back(c.run());
      }
    nlohmann::json j = {{"scene", name_},
                        {"triangles", scene_->catalog().meta.input_triangles},
                        {"ray", set.name},
                        {"rays", set.rays}};
    std::vector<double> speeds;
    for (const Contender& c : contenders)
      speeds.push_back(static_cast<double>(set.rays) / Median(c.times) / 1e6);
    const auto best_of = [&](size_t from, size_t to) {
      return *std::max_element(speeds.begin() + static_cast<std::ptrdiff_t>(from),
                               speeds.begin() + static_cast<std::ptrdiff_t>(to));
    };
    j["mrays_per_s"] = speeds[0];
    if (one_level_) j["one_level_mrays_per_s"] = best_of(first_one_level, ours);
    const size_t robust = fast_ ? ours + 3 : ours;
    if (fast_) {
      j["embree_best_mrays_per_s"] = best_of(ours, robust);
      j["embree_single_mrays_per_s"] = speeds[ours];
    }
    if (robust_) j["embree_robust_best_mrays_per_s"] = best_of(robust, robust + 3);
    Print(fmt::format("  {:8} {:9} rays:", set.name, set.rays));
    for (size_t i = 0; i < contenders.size(); ++i)
      Print(fmt::format(" {} {:.2f}", contenders[i].name, speeds[i]));
    if (robust_) {
      contenders[0].run();
      robust_->Trace(EmbreeMode::kSingle);
      const Check check = Compare(*scene_, set, found_, *robust_);
      j["same"] = check.same;
      j["tie"] = check.tie;
      j["grazing"] = check.grazing;
      others_ += check.other;
      j["other"] = check.other;
      Print(fmt::format("\n      ratio to embree robust {:.2f}", speeds[0] / best_of(robust, robust + 3)));
      if (fast_)
        Print(fmt::format(" best {:.2f} single {:.2f}", speeds[0] / best_of(ours, robust),
                          speeds[0] / speeds[ours]));
      Print(fmt::format("; hits same {} tie {} grazing {} other {}", check.same, check.tie, check.grazing,
                        check.other));
    }
    Print("\n");
    std::fflush(stdout);
    if (options_.statistics) PrintStatistics(set);
    results.push_back(std::move(j));
  }

  /// Every kernel against the first, the suspended rays a sixteenth of all.
  Status CompareKernels() {
    constexpr size_t kPackets = 1024;
    const SceneMeta& meta = scene_->catalog().meta;
    std::mt19937 random(77);
    const auto point = [&] {
      glm::vec3 p;
      for (int a = 0; a < 3; ++a)
        p[a] = meta.root_lower[a] +
               (meta.root_upper[a] - meta.root_lower[a]) * static_cast<float>(random() >> 8) * 0x1p-24f;
      return p;
    };
    uint64_t rays = 0, suspended = 0, hits = 0, mismatches = 0;
    std::vector<RayPacket> fresh(kPackets);
    for (; rays < options_.identical; rays += kPackets * RayPacket::kRays) {
      for (RayPacket& packet : fresh) {
        // Half of the packets fan out from one point, half are of unrelated rays.
        const bool fan = random() % 2 != 0;
        const glm::vec3 eye = point(), at = point();
        for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
          Ray ray;
          ray.origin = fan ? eye : point();
          const glm::vec3 to = (fan ? at + (point() - at) * 0.01f : point()) - ray.origin;
          ray.direction = to / std::max(std::sqrt(to.x * to.x + to.y * to.y + to.z * to.z), 1e-20f);
          packet.Set(i, ray);
        }
      }
      std::vector<RayPacket> expected;
      for (const Variant& kernel : AllKernels()) {
        const SceneView& view = scene_->view(kernel.layout);
        found_ = fresh;
        TraceAll(view, kernel.closest, found_);
        if (expected.empty()) expected = found_;
        mismatches += Differences(expected, found_);
        found_.assign(fresh.begin(), fresh.begin() + kPackets / 16);
        TraceSuspending(view, kernel.closest, found_);
        mismatches += Differences(expected, found_);
        suspended += found_.size() * RayPacket::kRays;
      }
      for (const RayPacket& packet : expected)
        hits += static_cast<uint64_t>(std::count_if(packet.triangle, packet.triangle + RayPacket::kRays,
                                                    [](uint32_t id) { return id != kNoTriangle; }));
    }
    Print(fmt::format("{}: {} rays, {} hits, {} kernels, {} suspended: {} mismatches\n", name_, rays, hits,
                      AllKernels().size(), suspended, mismatches));
    if (mismatches != 0) return Fail(fmt::format("{}: kernels disagree on {} rays", name_, mismatches));
    return {};
  }

  static uint64_t Differences(const std::vector<RayPacket>& a, const std::vector<RayPacket>& b) {
    uint64_t n = 0;
    for (size_t p = 0; p < b.size(); ++p)
      for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
        const Hit x = a[p].HitOf(i), y = b[p].HitOf(i);
        n += x.triangle != y.triangle || std::memcmp(&x.t, &y.t, 4) != 0 ||
             std::memcmp(&x.b1, &y.b1, 4) != 0 || std::memcmp(&x.b2, &y.b2, 4) != 0;
      }
    return n;
  }

  void PrintStatistics(const RaySet& set) {
    for (const Variant& kernel : AllKernels()) {
      if (!IsBest(kernel)) continue;
      if (!options_.only.empty() && kernel.name().find(options_.only) == std::string::npos) continue;
      found_ = set.packets;
      TraceStatistics s;
      const SceneView& view = scene_->view(kernel.layout);
      (set.any ? kernel.counted_any : kernel.counted_closest)(view.top(), view.finder(), found_.data(),
                                                              set.active.data(),
                                                              static_cast<uint32_t>(found_.size()), s);
      const auto per_ray = [&](uint64_t n) { return static_cast<double>(n) / static_cast<double>(set.rays); };
      Print(fmt::format(
          "      {}: a ray: node steps {:.2f} (lanes used {:.2f}), leaves {:.2f}, triangle tests {:.2f} "
          "({:.2f}), "
          "exact {:.2f}, climbs {:.2f}, voxels {:.2f}\n",
          kernel.grouping, per_ray(s.node_steps),
          static_cast<double>(s.node_lanes_used) / static_cast<double>(s.node_lanes), per_ray(s.leaves),
          per_ray(s.triangle_tests),
          static_cast<double>(s.triangle_lanes_used) / static_cast<double>(s.triangle_lanes),
          per_ray(s.exact_tests), per_ray(s.climbs), per_ray(s.voxel_visits)));
    }
  }

  using SceneView = test::SceneView;
  const Options& options_;
  std::string name_;
  std::unique_ptr<test::ResidentScene> scene_;
  std::unique_ptr<ResidentCache> cache_;
  std::vector<RaySet> sets_;
  uint64_t others_ = 0;  ///< rays whose hits differ from Embree's for no reason known
  std::unique_ptr<EmbreeRays> fast_, robust_;
  std::unique_ptr<OneLevelScene> one_level_;
  std::vector<RayPacket> found_;
};

int Main(int argc, char** argv) {
  Options options;
  CLI::App app("Kernels against Embree on one core: millions of rays a second.");
  app.add_option("store", options.stores, "Stores made by quarry-preprocess")->required();
  app.add_option("--repetitions", options.repetitions, "Medians of so many")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  app.add_option("--size", options.size, "Pixels on a side, a multiple of 8")
      ->check(CLI::Range(8, 16384))
      ->capture_default_str();
  app.add_flag("--one-level", options.one_level, "Beside them one tree over all triangles, without voxels");
  app.add_flag("--interior", options.interior, "The eye is inside the scene's box");
  app.add_option("--only", options.only, "Kernels whose names hold this alone");
  app.add_option("--rays", options.rays, "This kind of ray alone");
  const std::map<std::string, RayOrder> orders{{"pixels", RayOrder::kPixels},
                                               {"place", RayOrder::kPlace},
                                               {"octant", RayOrder::kOctant},
                                               {"place-octant", RayOrder::kPlaceOctant},
                                               {"octant-place", RayOrder::kOctantPlace}};
  std::string order = "pixels";
  app.add_option("--order", order, "Put rays in another order first; sorting is not counted")
      ->check(CLI::IsMember(orders))
      ->capture_default_str();
  app.add_flag("--all", options.all, "All kernels, not only those that renders use");
  app.add_flag("--no-embree", options.no_embree, "Quarry alone");
  app.add_flag("--robust-only", options.robust_only, "Embree in robust mode alone: half of its memory");
  app.add_flag("--statistics", options.statistics, "Count nodes, leaves, triangles");
  app.add_option(
      "--identical", options.identical,
      "Instead: so many random rays through every kernel, resident and suspended, hits compared bit by bit");
  app.add_option("--json", options.json, "Results as JSON")->check(bench::CheckFigures);
  if (const auto status = ReadArguments(app, argc, argv)) return *status;
  options.order = orders.at(order);
  const auto fail = [](const std::string& message) {
    Log(fmt::format("quarry-bench-kernels: {}", message));
    return 2;
  };
  if (options.size % RayPacket::kSide != 0) return fail("--size: not a multiple of 8");
  if (AllKernels().empty()) return fail("QUARRY_ISA names no instruction set that this processor has");
  nlohmann::json results = nlohmann::json::array();
  int exit_status = 0;
  for (const std::string& store : options.stores) {
    SceneBench bench(options, std::filesystem::path(store).stem().string());
    const Status status = bench.Run(store, results);
    // After every scene: large ones take long, and an end before the last one loses no figures.
    (void)bench::WriteFigures(options.json, results.dump(2));
    if (status) continue;
    Log(fmt::format("quarry-bench-kernels: {}", status.error().message));
    exit_status = 1;
  }
  return exit_status;
}

}  // namespace
}  // namespace quarry::bench

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry bench kernels", "figures that were printed stand"}, argc, argv,
                            quarry::bench::Main);
}

#include "tests/laboratory/tables/papers_scene.h"

#include <fmt/format.h>

#include <bit>
#include <filesystem>

#include "common/base/check.h"
#include "common/scene/camera.h"
#include "tests/bench/stopwatch.h"
#include "tests/bench/views.h"
#include "tests/laboratory/structures/stack_trace.h"
#include "tests/laboratory/structures/store_tree.h"
#include "tests/laboratory/variants/simt.h"

namespace quarry::laboratory {
namespace {

using bench::Clock;

constexpr float kFarthest = std::numeric_limits<float>::max();
constexpr uint32_t kOtherGrid = 64;  // of scenes that are not the paper's: Purcell et al. 2002, section 4.2

double Seconds(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Of a frame with `size` pixels on a side.
MemoryNeeds NeedsOf(uint32_t size) {
  // Each ray is held as such, with its hit, and in a packet that is traced and one that is not.
  constexpr uint64_t kPixelBytes = sizeof(RayStart) + sizeof(Hit) + 2 * sizeof(RayPacket) / RayPacket::kRays;
  return {.structure_bytes = kGridBytes + 2 * kTreeBytes,
          .pixels = uint64_t{size} * size,
          .bytes_per_pixel = kPixelBytes};
}

}  // namespace

const PaperFigures* FiguresOf(const std::string& store) {
  const std::string name = std::filesystem::path(store).stem();
  for (const PaperFigures& figures : kPaperFigures)
    if (name == figures.store) return &figures;
  return nullptr;
}

Status PapersScene::Check(const std::string& store, uint32_t size) {
  QUARRY_ASSIGN(const StoreReader opened, StoreReader::Open(store));
  return LaboratoryScene::Check(store, opened.catalog(), NeedsOf(size));
}

Result<std::unique_ptr<PapersScene>> PapersScene::Load(const std::string& store, uint32_t size) {
  constexpr uint32_t kSide = RayPacket::kSide;
  auto self = std::make_unique<PapersScene>();
  QUARRY_ASSIGN(self->scene_, LaboratoryScene::Load(store, NeedsOf(size)));
  LaboratoryScene& scene = *self->scene_;
  self->paper_ = FiguresOf(store);
  self->name_ = self->paper_ ? self->paper_->name : std::filesystem::path(store).stem().string();
  const SceneMeta& meta = scene.catalog().meta;
  QUARRY_ASSIGN(const CameraSpec view, bench::FindView(store, meta, false));
  const Camera camera(view, size, size, meta.root_lower, meta.root_upper);
  const uint32_t across = size / kSide;
  self->packets_.resize(size_t{across} * across);
  self->active_.resize(self->packets_.size());
  for (size_t p = 0; p < self->packets_.size(); ++p)
    for (uint32_t i = 0; i < RayPacket::kRays; ++i) {
      const size_t x = p % across * kSide + i % kSide, y = p / across * kSide + i / kSide;
      const PrimaryRay shot = camera.Shoot(static_cast<double>(x) + 0.5, static_cast<double>(y) + 0.5);
      Ray ray;
      ray.origin = shot.origin;
      ray.direction = shot.direction;
      self->packets_[p].Set(i, ray);
      if (shot.misses) continue;
      self->active_[p] |= uint64_t{1} << i;
      self->rays_.push_back(
          {{ray.origin.x, ray.origin.y, ray.origin.z}, {ray.direction.x, ray.direction.y, ray.direction.z}});
    }
  const Box box = scene.box();
  const GridResolution cells = self->paper_ ? self->paper_->grid : CubicalResolution(box, kOtherGrid);
  self->grid_ =
      std::make_unique<UniformGrid>(scene.triangles(), scene.padding(), box, cells, scene.addresses());
  for (size_t which = 0; which < 2; ++which) {
    Tree& tree = self->trees_[which];
    const auto start = Clock::now();
    QUARRY_ASSIGN(const KdTree plain, which == 0 ? BuildFoleyTree(scene.triangles(), scene.padding(), box)
                                                 : ReadStoreTree(scene));
    tree.build_seconds = Seconds(start);
    tree.tree = std::make_unique<TextureTree>(plain, box, scene.addresses());
    tree.ropes = std::make_unique<KdRopes>(plain, box, scene.addresses());
  }
  return self;
}

template <class TraceRay>
Result<FrameCounts> PapersScene::Count(const TraceRay& trace) {
  FrameCounts counts;
  FetchCounter memory;
  const bool first = hits_.empty();
  uint64_t differences = 0;
  for (size_t i = 0; i < rays_.size(); ++i) {
    Hit hit = trace(rays_[i], memory, counts);
    if (hit.triangle == kNoTriangle) hit = {};  // as RayPacket::HitOf()
    if (first)
      hits_.push_back(hit);
    else
      differences += Same(hit, hits_[i]) ? 0 : 1;
  }
  if (differences != 0) return Fail(fmt::format("{}: structures disagree on {} rays", name_, differences));
  counts.words = memory.words;
  return counts;
}

Result<std::vector<TreeCounts>> PapersScene::CountTrees() {
  std::vector<TreeCounts> all;
  for (size_t which = 0; which < 2; ++which) {
    const TextureTree& tree = *trees_[which].tree;
    const auto by = [&](const auto& way) {
      return Count([&](const RayStart& ray, FetchCounter& memory, TraceCounts& counts) {
        return TraceOne(way, scene_->corners(), memory, ray, kFarthest, counts);
      });
    };
    TreeCounts counts{which == 0 ? "theirs" : "ours",
                      tree.splits(),
                      tree.leaves(),
                      tree.references(),
                      tree.depth(),
                      trees_[which].build_seconds,
                      {},
                      {},
                      {},
                      {},
                      {}};
    QUARRY_ASSIGN(counts.stack, Count([&](const RayStart& ray, FetchCounter& memory, TraceCounts& of_ray) {
                    return TraceWithStack(tree, scene_->corners(), memory, ray, kFarthest, of_ray);
                  }));
    QUARRY_ASSIGN(counts.restart, by(KdRestart(tree)));
    QUARRY_ASSIGN(counts.backtrack, by(KdBacktrack(tree)));
    QUARRY_ASSIGN(counts.push_down, by(KdPushDown(tree)));
    QUARRY_ASSIGN(counts.ropes, by(*trees_[which].ropes));
    all.push_back(std::move(counts));
  }
  return all;
}

Result<FrameCounts> PapersScene::CountGrid() {
  return Count([&](const RayStart& ray, FetchCounter& memory, TraceCounts& counts) {
    return TraceOne(*grid_, scene_->corners(), memory, ray, kFarthest, counts);
  });
}

template <class F>
void PapersScene::ForRays(const F& f) const {
  size_t ray = 0;
  for (size_t p = 0; p < packets_.size(); ++p)
    for (uint64_t left = active_[p]; left != 0; left &= left - 1)
      f(ray++, p, static_cast<uint32_t>(std::countr_zero(left)));
}

uint64_t PapersScene::Differences(const std::vector<RayPacket>& found) const {
  QUARRY_CHECK_EQ(hits_.size(), rays_.size());
  QUARRY_CHECK_EQ(found.size(), packets_.size());
  uint64_t differences = 0;
  ForRays(
      [&](size_t ray, size_t p, uint32_t i) { differences += Same(hits_[ray], found[p].HitOf(i)) ? 0 : 1; });
  return differences;
}

Result<std::vector<Timing>> PapersScene::Time(int repetitions, bool brute_force) {
  const SimtFunctions& simt = BestSimt();
  const std::vector<float> corners = CornersOf(*scene_);
  const SimtScene lanes = SceneOf(*scene_, corners);
  const SimtGrid grid = GridOf(*grid_);
  const SimtTree trees[2] = {TreeOf(*trees_[0].tree), TreeOf(*trees_[1].tree)};
  struct Structure {
    std::string name;
    std::function<void(SimtRays)> trace;
  };
  const std::vector<Structure> structures = {
      {"brute", [&](SimtRays rays) { simt.brute(lanes, rays); }},
      {"grid", [&](SimtRays rays) { simt.grid(lanes, grid, rays); }},
      {NameOf("restart", 0), [&](SimtRays rays) { simt.restart(lanes, trees[0], rays); }},
      {NameOf("backtrack", 0), [&](SimtRays rays) { simt.backtrack(lanes, trees[0], rays); }},
      {NameOf("restart", 1), [&](SimtRays rays) { simt.restart(lanes, trees[1], rays); }},
      {NameOf("backtrack", 1), [&](SimtRays rays) { simt.backtrack(lanes, trees[1], rays); }}};
  std::vector<Timing> timings;
  for (const Structure& structure : structures) {
    if (!brute_force && &structure == structures.data()) continue;
    Timing timing{structure.name, {}};
    for (int r = 0; r < repetitions; ++r) {
      std::vector<RayPacket> found = packets_;
      const SimtRays rays{found.data(), active_.data(), static_cast<uint32_t>(found.size())};
      const double start = bench::ProcessSeconds();
      structure.trace(rays);
      timing.seconds.push_back(bench::ProcessSeconds() - start);
      if (hits_.empty()) ForRays([&](size_t, size_t p, uint32_t i) { hits_.push_back(found[p].HitOf(i)); });
      if (const uint64_t differences = Differences(found))
        return Fail(fmt::format("{}: {} finds other hits for {} rays", name_, structure.name, differences));
    }
    timings.push_back(std::move(timing));
  }
  return timings;
}

}  // namespace quarry::laboratory

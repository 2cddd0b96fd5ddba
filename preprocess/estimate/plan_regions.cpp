#include "preprocess/estimate/plan_regions.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

#include "common/base/resource.h"
#include "common/kdtree/trace/triangle_test.h"
#include "preprocess/partition/partition.h"
#include "preprocess/partition/split.h"
#include "preprocess/partition/voxel_builder.h"
#include "preprocess/partition/voxel_pipeline.h"
#include "preprocess/smooth/smooth_region.h"

namespace quarry {
namespace {

// Regions that are built: three of a small model (half of a model of a million triangles), six of a large
// model, whose parts differ in cost.
constexpr size_t kFewestRegions = 3, kMostRegions = 6, kRegionsPerChosen = 8;
// Triangles of a region that are kept; a larger region ends in voxel chains, for which these are enough. More
// than are split in memory, so that they take the path that the run takes.
constexpr uint64_t kMostOfRegion = kMostInMemory + kMostInMemory / 4;
constexpr uint64_t kRun =
    8192;  // consecutive triangles that are kept together, since neighbours share vertices
constexpr uint64_t kSharedElements = 1 << 15;  // of a file, packed to measure how spill shrinks

}  // namespace

Status ResolvingSink::BeginFile(std::string_view) {
  positions_.Clear();
  normals_.Clear();
  colors_.Clear();
  uvs_.Clear();
  held_ = 0;
  face_color_ = 0xFFFFFFFFu;
  smoothing_ = kSmoothByAngle;
  return {};
}

/// Takes memory for one more element, or gives up.
void ResolvingSink::Hold(uint64_t bytes) {
  held_ += bytes;
  if (held_ <= memory_) return;
  gave_up_ = true;
  Release();
}

Status ResolvingSink::AddPosition(const glm::dvec3& position, const Rgba8& color) {
  if (gave_up_) return {};
  Hold(sizeof(glm::vec3) + (attributes_ ? sizeof(uint32_t) : 0));
  positions_.Add(coordinates_.Store(position));
  if (attributes_) colors_.Add(Packed(color));
  return {};
}

Status ResolvingSink::AddNormal(const glm::vec3& normal) {
  if (gave_up_ || !attributes_) return {};
  Hold(sizeof normal);
  normals_.Add(glm::vec3(coordinates_.Direction(glm::dvec3(normal))));
  return {};
}

Status ResolvingSink::AddUv(const glm::vec2& uv) {
  if (gave_up_ || !attributes_) return {};
  Hold(sizeof uv);
  uvs_.Add(uv);
  return {};
}

bool ResolvingSink::Resolve(const Corner (&corners)[3], TriangleRecord& record) const {
  for (size_t k = 0; k < 3; ++k) {
    const Corner& corner = corners[k];
    if (corner.position >= positions_.size()) return false;
    record.vertices[k] = positions_[corner.position];
    if (!attributes_) continue;
    record.colors[k] = face_color_ == 0xFFFFFFFFu ? colors_[corner.position] : face_color_;
    if (corner.normal < normals_.size()) record.normals[k] = normals_[corner.normal];
    if (corner.uv < uvs_.size()) record.uvs[k] = uvs_[corner.uv];
  }
  return true;
}

Status ResolvingSink::SetFaceColor(const Rgba8& color) {
  face_color_ = Packed(color);
  return {};
}

Status ResolvingSink::AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) {
  fan_.clear();
  bool resolved = !gave_up_;
  for (size_t i = 2; i < corners.size(); ++i) {
    TriangleRecord record;
    record.id = next_id_++;
    record.material = static_cast<uint16_t>(material == kNoIndex ? 0 : material);
    record.smoothing = smoothing_;
    record.part = part == kNoIndex ? 0 : part;
    const Corner triangle[3] = {corners[0], corners[i - 1], corners[i]};
    resolved = resolved && Resolve(triangle, record);
    MarkOwnNormals(record);
    if (resolved) fan_.push_back(record);
  }
  if (!resolved || fan_.empty()) return {};
  if (fan_.size() > 1) polygon_.Split(fan_);
  for (const TriangleRecord& record : fan_)
    if (FaultOf(record) == TriangleFault::kNone) QUARRY_TRY(Take(record));
  return {};
}

PlannedRegions PlanRegions(TriangleSurvey& survey) {
  PlannedRegions plan;
  float largest = 0;
  for (int a = 0; a < 3; ++a)
    largest = std::max({largest, std::fabs(survey.bounds.lower[a]), std::fabs(survey.bounds.upper[a])});
  plan.padding = ReferencePadding(largest);
  plan.whole.cell = {survey.bounds.lower - glm::vec3(2 * plan.padding),
                     survey.bounds.upper + glm::vec3(2 * plan.padding)};
  const uint64_t weight = survey.sample.weight();
  const std::vector<KdTriangle> sample = survey.sample.TakeTriangles();
  if (survey.triangles <= kMostInMemory)
    plan.tree = {{KdNode::Leaf(0, 1)}, {plan.whole}, {0}};
  else
    plan.tree = ChooseRegions(sample, weight, plan.padding, plan.whole);
  const size_t regions = plan.tree.regions.size();
  plan.expected.resize(regions);
  for (const KdTriangle& t : sample) {
    TriangleRecord record;
    for (size_t k = 0; k < 3; ++k) record.vertices[k] = t.vertices[k];
    ForEachRegion(plan.tree, record, plan.padding,
                  [&](uint32_t region, const Box&) { plan.expected[region] += weight; });
  }
  // Regions are chosen at equal steps through all triangles of all regions.
  const size_t choices =
      std::min(regions, std::clamp(regions / kRegionsPerChosen, kFewestRegions, kMostRegions));
  const uint64_t all = std::accumulate(plan.expected.begin(), plan.expected.end(), uint64_t{0});
  uint64_t before = 0;
  size_t choice = 0;
  for (uint32_t r = 0; r < regions; ++r) {
    before += plan.expected[r];
    const size_t first = choice;
    while (choice < choices && (2 * choice + 1) * all < before * 2 * choices) ++choice;
    if (choice == first) continue;
    plan.chosen.push_back(r);
    plan.weights.push_back(static_cast<uint32_t>(choice - first));
  }
  return plan;
}

uint64_t KeptBytes(const PlannedRegions& regions, Attributes attributes) {
  uint64_t triangles = 0;
  for (const uint32_t region : regions.chosen) triangles += std::min(regions.expected[region], kMostOfRegion);
  return triangles * RecordBytes(attributes);
}

RegionSink::RegionSink(const PreprocessOptions& options, uint64_t memory, PlannedRegions& regions,
                       Attributes attributes, std::string folder)
    : ResolvingSink(options, memory, attributes != Attributes::kNone),
      options_(options),
      regions_(regions),
      attributes_(attributes),
      folder_(std::move(folder)),
      counts_(regions.tree.regions.size()),
      contents_(regions.tree.regions.size(), EmptyBox()),
      kept_of_(regions.tree.regions.size(), kNoIndex),
      kept_(regions.chosen.size()) {
  for (uint32_t k = 0; k < kept_.size(); ++k) {
    kept_of_[regions.chosen[k]] = k;
    kept_[k].every = std::max<uint64_t>(1, regions.expected[regions.chosen[k]] / kMostOfRegion);
  }
}

Status RegionSink::Take(const TriangleRecord& record) {
  ++taken_;
  Status status;
  ForEachRegion(regions_.tree, record, regions_.padding, [&](uint32_t region, const Box& part) {
    contents_[region].Include(part.lower);
    contents_[region].Include(part.upper);
    const uint64_t number = counts_[region]++;
    if (kept_of_[region] == kNoIndex || !status) return;
    Kept& kept = kept_[kept_of_[region]];
    if (number / kRun % kept.every != 0) return;
    if (!kept.file) {
      auto file = SpillFile::Open(fmt::format("{}/region-{}", folder_, region), RecordBytes(attributes_), 0);
      if (!file) return void(status = tl::unexpected<Error>(file.error()));
      kept.file.emplace(std::move(*file));
    }
    if (kept.file->count() < kMostOfRegion) status = kept.file->Append(&record);
  });
  return status;
}

/// Packed bytes over bytes, of the kept records in spill files.
Result<double> RegionSink::SpilledShare() {
  uint64_t all = 0, packed = 0;
  for (Kept& kept : kept_) {
    if (!kept.file) continue;
    Bytes bytes(std::min(kept.file->count(), kSharedElements) * kept.file->element_bytes());
    QUARRY_TRY(kept.file->Read(0, bytes));
    all += bytes.size();
    packed += SpillFile::PackedBytes(bytes);
  }
  return static_cast<double>(packed) / static_cast<double>(all);
}

/// Builds the voxels of a chosen region; returns their bytes in the store.
Result<double> RegionSink::BuildRegion(size_t kept) {
  double bytes = 0;
  VoxelPipeline pipeline(
      options_.threads,
      [&](const VoxelTask& task) {
        return BuildVoxel(task.triangles, task.cell, regions_.padding,
                          {attributes_ != Attributes::kNone, options_.crease > 0}, options_.voxel_size);
      },
      [&](const EncodedVoxel& voxel) {
        bytes += static_cast<double>(voxel.hot.size() + voxel.shading.size());
        return Status{};
      });
  const uint32_t region = regions_.chosen[kept];
  const PartitionOptions partition{regions_.padding, options_.voxel_size, options_.memory / 4,
                                   fmt::format("{}/part-{}-", folder_, region)};
  QUARRY_TRY(PartitionSmoothed(*kept_[kept].file, regions_.tree.regions[region], contents_[region], partition,
                               nullptr, options_.crease,
                               [&](VoxelTask task) { return pipeline.Add(std::move(task)); })
                 .map([](auto&&) {}));
  QUARRY_TRY(pipeline.Finish());
  return bytes;
}

Result<SampleCost> RegionSink::Measure() {
  if (taken_ < kFewestTriangles) return kUsualCost;
  for (Kept& kept : kept_)
    if (kept.file) QUARRY_TRY(kept.file->FinishWriting());
  SampleCost cost;
  QUARRY_ASSIGN(cost.spilled, SpilledShare());
  if (taken_ > kMostInMemory) CutOffEmptySpace(contents_, regions_.whole.cell, regions_.tree);
  double weights = 0;
  for (size_t k = 0; k < kept_.size(); ++k) {
    if (!kept_[k].file) continue;
    const auto start = std::chrono::steady_clock::now();
    QUARRY_ASSIGN(const double bytes, BuildRegion(k));
    const double weight = regions_.weights[k], count = static_cast<double>(kept_[k].file->count());
    cost.seconds += weight * SecondsSince(start) / count;
    cost.bytes += weight * bytes / count;
    weights += weight;
    kept_[k].file->Remove();
  }
  if (weights == 0) return kUsualCost;
  const uint64_t references = std::accumulate(counts_.begin(), counts_.end(), uint64_t{0});
  cost.references = static_cast<double>(references) / static_cast<double>(taken_);
  cost.seconds *= cost.references / weights;
  cost.bytes *= cost.references / weights;
  return cost;
}

}  // namespace quarry

#include "preprocess/plan.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <vector>

#include "common/base/size.h"
#include "common/kdtree/triangle_test.h"
#include "preprocess/import/importer.h"
#include "preprocess/partition.h"
#include "preprocess/split.h"
#include "preprocess/voxel_builder.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

constexpr uint64_t kWindows = 4;                  // places that the sample comes from
constexpr uint64_t kWindowVertices = 1u << 16;    // neighbours in the file, of each
constexpr uint64_t kWindowTriangles = 1u << 15;   // at most
constexpr uint64_t kFewest = 1000;                // triangles of a sample that tells something
constexpr uint64_t kOverheadBytes = 44ull << 20;  // of a run beyond --memory: README
constexpr double kMoreBytes = 1.08;     // a triangle of all than of a sample, which has fewer copies
constexpr double kMoreVertices = 1.15;  // in voxels than in files
constexpr double kOverlap = 0.88;       // of the threads' time is used, measured with 2

double SecondsSince(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Counts, of one file after the other.
struct Counts {
  uint64_t positions = 0, normals = 0, uvs = 0, triangles = 0;
};

class CountingSink : public ModelSink {
 public:
  Status BeginFile(std::string_view) override {
    files.emplace_back();
    return {};
  }
  Status EndFile() override { return {}; }
  uint32_t AddMaterial(const Material&) override { return materials_++; }
  uint32_t AddPart(std::string_view) override { return 0; }
  Status AddPosition(const glm::dvec3&, const Rgba8& color) override {
    ++files.back().positions;
    has_color |= (color.r & color.g & color.b & color.a) != 255;
    return {};
  }
  Status AddNormal(const glm::vec3&) override {
    ++files.back().normals;
    return {};
  }
  Status AddUv(const glm::vec2&) override {
    ++files.back().uvs;
    return {};
  }
  Status AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) override {
    if (corners.size() >= 3) files.back().triangles += corners.size() - 2;
    return {};
  }
  void Warn(std::string) override {}

  std::vector<Counts> files;
  bool has_color = false;

 private:
  uint32_t materials_ = 0;
};

/// Keeps the vertices of windows spread over the largest file, and the triangles whose corners lie in one.
class SamplingSink : public ModelSink {
 public:
  SamplingSink(size_t file, uint64_t vertices, double scale)
      : file_(file), scale_(scale), step_(std::max(vertices / kWindows, kWindowVertices)), taken_(kWindows) {}

  Status BeginFile(std::string_view) override {
    ++begun_;
    next_ = 0;
    return {};
  }
  Status EndFile() override { return {}; }
  uint32_t AddMaterial(const Material&) override { return materials_++; }
  uint32_t AddPart(std::string_view) override { return parts_++; }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override {
    if (!here()) return {};
    if (next_ == 0) origin_ = position;
    if (next_ % step_ < kWindowVertices && next_ / step_ < kWindows)
      vertices_.push_back({glm::vec3((position - origin_) * scale_), color});
    ++next_;
    return {};
  }
  Status AddNormal(const glm::vec3&) override { return {}; }
  Status AddUv(const glm::vec2&) override { return {}; }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override {
    if (corners.size() < 3) return {};
    const uint32_t first_id = next_id_;
    next_id_ += static_cast<uint32_t>(corners.size()) - 2;
    if (!here()) return {};
    const uint64_t window = corners[0].position / step_;
    for (const Corner& corner : corners)
      if (window >= kWindows || corner.position / step_ != window ||
          corner.position % step_ >= kWindowVertices)
        return {};
    for (size_t i = 2; i < corners.size() && taken_[window] < kWindowTriangles; ++i, ++taken_[window])
      triangles.push_back({{corners[0].position, corners[i - 1].position, corners[i].position},
                           first_id + static_cast<uint32_t>(i) - 2,
                           material == kNoIndex ? 0 : material,
                           part == kNoIndex ? 0 : part});
    return {};
  }
  void Warn(std::string) override {}

  struct Vertex {
    glm::vec3 position;
    Rgba8 color;
  };
  /// Null for a vertex that has not come: a face may name what does not exist.
  const Vertex* Find(uint32_t index) const {
    const uint64_t at = index / step_ * kWindowVertices + index % step_;
    return at < vertices_.size() ? &vertices_[at] : nullptr;
  }
  struct Triangle {
    uint32_t corners[3];
    uint32_t id, material, part;
  };
  std::vector<Triangle> triangles;

 private:
  bool here() const { return begun_ == file_ + 1; }

  size_t file_, begun_ = 0;
  double scale_;
  uint64_t step_, next_ = 0;
  glm::dvec3 origin_{0};
  std::vector<Vertex> vertices_;
  std::vector<uint64_t> taken_;
  uint32_t next_id_ = 0, materials_ = 0, parts_ = 0;
};

Status ReadModels(const PreprocessOptions& options, ModelSink& sink) {
  for (const std::string& model : options.models) {
    if (model == "-") return BadUsage("--plan reads models twice, which standard input does not allow");
    const std::string prefix = fmt::format("{}/quarry-foreign-{}", SpillFolder(options), ::getpid());
    QUARRY_TRY(ImportModel(model, sink, ForeignFormatsOf(options, prefix)));
  }
  return {};
}

struct SampleCost {
  double seconds = 0, bytes = 0;  ///< a triangle, on one thread
};
constexpr SampleCost kUsual{6e-6, 13};

/// Makes voxels of the sample, as a run does of all.
Result<SampleCost> MeasureSample(const PreprocessOptions& options, const SamplingSink& sample,
                                 bool has_shading) {
  std::vector<TriangleRecord> records;
  Box bounds = EmptyBox();
  float largest = 0;
  for (const SamplingSink::Triangle& t : sample.triangles) {
    TriangleRecord record;
    record.id = t.id;
    record.material = t.material;
    record.part = t.part;
    bool whole = true;
    for (size_t k = 0; k < 3; ++k) {
      const SamplingSink::Vertex* vertex = sample.Find(t.corners[k]);
      whole &= vertex != nullptr;
      if (!vertex) continue;
      record.vertices[k] = vertex->position;
      record.colors[k] = Packed(vertex->color);
    }
    const Box box = record.PaddedBox(0);
    for (int a = 0; a < 3; ++a) {
      whole &= std::abs(box.lower[a]) < 1e30f && std::abs(box.upper[a]) < 1e30f;
      largest = std::max({largest, std::abs(box.lower[a]), std::abs(box.upper[a])});
    }
    if (!whole) continue;
    bounds.Include(box.lower);
    bounds.Include(box.upper);
    records.push_back(record);
  }
  const auto count = static_cast<double>(records.size());
  // Triangles whose corners lie far apart in the file, or nowhere: what a triangle took in the scenes
  // measured.
  if (records.size() < kFewest) return kUsual;
  const float padding = ReferencePadding(largest);
  bounds.lower -= glm::vec3(2 * padding);
  bounds.upper += glm::vec3(2 * padding);
  double bytes = 0;
  const auto start = Clock::now();
  const PartitionOptions partition{padding, options.voxel_size, options.memory, ""};
  QUARRY_TRY(PartitionInMemory(records, {bounds}, partition, [&](const VoxelTask& task) -> Status {
    const EncodedVoxel voxel =
        BuildVoxel(task.triangles, task.cell, padding, has_shading, options.voxel_size);
    bytes += static_cast<double>(voxel.hot.size() + voxel.shading.size());
    return {};
  }));
  return SampleCost{SecondsSince(start) / count, bytes / count};
}

/// The most spill at once: while a file is imported, or when all triangles have been parted: a slice of them
/// is in both places, and those that touch several regions in each.
uint64_t SpillPeak(const std::vector<Counts>& files, Attributes attributes) {
  uint64_t peak = 0, triangles = 0;
  const uint64_t record = RecordBytes(attributes);
  for (const Counts& f : files) {
    triangles += f.triangles;
    peak = std::max(peak, triangles * record + f.positions * 16 + f.normals * 12 + f.uvs * 8);
  }
  if (triangles <= kMostInMemory) return peak;
  return std::max(peak, (triangles + triangles / 20 + std::min(triangles, kPartedAtOnce)) * record);
}

}  // namespace

Result<PreprocessPlan> MakePlan(const PreprocessOptions& options) {
  CountingSink counted;
  const auto start = Clock::now();
  QUARRY_TRY(ReadModels(options, counted));
  const double reading_s = SecondsSince(start);
  PreprocessPlan plan;
  size_t largest = 0;
  uint64_t normals = 0, uvs = 0;
  for (size_t i = 0; i < counted.files.size(); ++i) {
    const Counts& f = counted.files[i];
    plan.triangles += f.triangles;
    plan.vertices += f.positions;
    normals += f.normals;
    uvs += f.uvs;
    if (f.triangles > counted.files[largest].triangles) largest = i;
  }
  plan.has_shading = counted.has_color || normals + uvs != 0;
  SamplingSink sample(largest, counted.files[largest].positions, options.scale);
  QUARRY_TRY(ReadModels(options, sample));
  QUARRY_ASSIGN(const SampleCost cost, MeasureSample(options, sample, plan.has_shading));
  const auto triangles = static_cast<double>(plan.triangles);
  // The sample has no normals and texture coordinates: nearly all bits of those are random.
  const double shading = (static_cast<double>(normals) * 9 + static_cast<double>(uvs) * 6) * kMoreVertices;
  plan.store_bytes = static_cast<uint64_t>(triangles * cost.bytes * kMoreBytes + shading);
  const Attributes attributes = uvs                 ? Attributes::kUvs
                                : normals           ? Attributes::kNormals
                                : counted.has_color ? Attributes::kColors
                                                    : Attributes::kNone;
  plan.spill_bytes = SpillPeak(counted.files, attributes);
  plan.memory_bytes = options.memory + kOverheadBytes;
  const double threads = options.threads > 1 ? kOverlap * options.threads : 1;
  plan.seconds = 2 * reading_s + triangles * cost.seconds / threads;
  return plan;
}

bool RoomIsTight(const PreprocessOptions& options) {
  namespace fs = std::filesystem;
  // No format is as terse as this, unpacked or not; packed ones come near.
  constexpr uint64_t kMostGrowth = 40;
  std::error_code error;
  uint64_t models = 0;
  for (const std::string& model : options.models) {
    const auto size = fs::file_size(model, error);
    if (error) return false;  // a run will say what is wrong with it; standard input cannot be read twice
    models += size;
  }
  const auto space = fs::space(SpillFolder(options), error);
  return !error && space.available < models * kMostGrowth;
}

Status CheckRoom(const PreprocessOptions& options, const PreprocessPlan& plan) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path store = fs::path(options.output).parent_path(), spill = SpillFolder(options);
  const auto store_space = fs::space(store.empty() ? "." : store, error),
             spill_space = fs::space(spill, error);
  if (error) return {};  // a run will say what is wrong with the folders
  const bool same = store_space.capacity == spill_space.capacity && store_space.free == spill_space.free;
  // The store grows while spill shrinks.
  const uint64_t wanted =
      same ? std::max(plan.spill_bytes + plan.store_bytes / 4, plan.store_bytes) : plan.spill_bytes;
  if (wanted > spill_space.available)
    return Fail(fmt::format("{}: about {} of spill{} are needed, but {} are free; --tmp names another folder",
                            spill.string(), FormatSize(wanted), same ? " and store" : "",
                            FormatSize(spill_space.available)));
  if (!same && plan.store_bytes > store_space.available)
    return Fail(fmt::format("{}: about {} are needed for the store, but {} are free", options.output,
                            FormatSize(plan.store_bytes), FormatSize(store_space.available)));
  return {};
}

}  // namespace quarry

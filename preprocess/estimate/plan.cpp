#include "preprocess/estimate/plan.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <optional>
#include <system_error>
#include <type_traits>
#include <vector>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "preprocess/estimate/plan_regions.h"
#include "preprocess/estimate/plan_sample.h"
#include "preprocess/estimate/plan_textures.h"
#include "preprocess/import/importer.h"
#include "preprocess/partition/regions.h"
#include "preprocess/smooth/border_normals.h"
#include "preprocess/spill/temporary_file.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

constexpr uint64_t kOverheadBytes = 44ull << 20;  // of a run beyond --memory: README.md, "Limits"
// Seconds a byte of a triangle's record: to resolve and spill it at import; to route it to regions and read
// it back. Fitted to models that the page cache holds (tests/bench/stores/plans).
constexpr double kImportSeconds = 3e-9, kRoutingSeconds = 6.5e-9;

/// Bytes for vertices; the rest of --memory is for building.
uint64_t MemoryForVertices(const PreprocessOptions& options) { return options.memory / 4 * 3; }

/// Counts of elements, one file after the other.
struct Counts {
  uint64_t positions = 0, normals = 0, uvs = 0, triangles = 0;
  VertexSample vertices;
};

class CountingSink final : public ResolvingSink {
 public:
  /// `images_path`: the file for images that models hold as text.
  CountingSink(const PreprocessOptions& options, std::string images_path)
      : ResolvingSink(options, MemoryForVertices(options), false),
        images(std::move(images_path)),
        textures_(options.textures) {}
  Status BeginFile(std::string_view name) override {
    files.emplace_back();
    return ResolvingSink::BeginFile(name);
  }
  bool takes_textures() const override { return textures_; }
  Result<uint32_t> AddTexture(TextureImage image) override { return images.Add(std::move(image)); }
  Status AddPosition(const glm::dvec3& position, const Rgba8& color) override {
    ++files.back().positions;
    files.back().vertices.Add(position);
    has_color |= (color.r & color.g & color.b & color.a) != 255;
    return ResolvingSink::AddPosition(position, color);
  }
  Status AddNormal(const glm::vec3&) override {
    ++files.back().normals;
    return {};
  }
  Status AddUv(const glm::vec2&) override {
    ++files.back().uvs;
    return {};
  }
  Status SetFaceColor(const Rgba8& color) override {
    has_color |= (color.r & color.g & color.b & color.a) != 255;
    return ResolvingSink::SetFaceColor(color);
  }
  Status AddPolygon(std::span<const Corner> corners, uint32_t material, uint32_t part) override {
    if (corners.size() >= 3) files.back().triangles += corners.size() - 2;
    return ResolvingSink::AddPolygon(corners, material, part);
  }

  TriangleSurvey survey;
  std::vector<Counts> files;
  bool has_color = false;
  ImageList images;

 private:
  Status Take(const TriangleRecord& record) override {
    const Box box = record.PaddedBox(0);
    survey.bounds.Include(box.lower);
    survey.bounds.Include(box.upper);
    survey.sample.Add(record);
    ++survey.triangles;
    return {};
  }

  const bool textures_;
};

std::string ForeignPrefix(const PreprocessOptions& options) {
  return fmt::format("{}/quarry-foreign-{}", SpillFolder(options), ::getpid());
}

/// Removes, at its end, the images that came out of foreign models.
struct ForeignImages {
  explicit ForeignImages(std::string of) : prefix(std::move(of)) {}
  ForeignImages(const ForeignImages&) = delete;
  ~ForeignImages() { RemoveForeignImages(prefix); }
  std::string prefix;
};

template <class Sink>
Status ReadModels(const PreprocessOptions& options, Sink& sink) {
  for (const std::string& model : options.models) {
    if (model == "-")
      return BadUsage("--plan reads models more than once, which standard input does not allow");
    if constexpr (std::is_base_of_v<ResolvingSink, Sink>) sink.Place(model);
    QUARRY_TRY(ImportModel(model, sink, ForeignFormatsOf(options, ForeignPrefix(options)),
                           options.unpack_limit, GltfDecodingOf(options, SpillFolder(options)),
                           CadReadingOf(options, SpillFolder(options))));
  }
  return {};
}

/// Most bytes of spill at any time: while a file is imported, or when all triangles have been routed. In the
/// second case a slice of triangles lies in both places, and a triangle in several regions lies in each.
/// Units: `record` in bytes of a triangle; `share` is the part of them that stays after packing; `references`
/// is regions per triangle.
uint64_t SpillPeak(const std::vector<Counts>& files, double record, double share, double references) {
  constexpr auto kLarge = static_cast<double>(SpillFile::kPackLarge);
  // The triangle file is packed beyond its first bytes; regions' files are packed entirely or not at all.
  const auto in_file = [&](double n) {
    return std::min(n * record, kLarge) + std::max(n * record - kLarge, 0.0) * share;
  };
  double peak = 0, triangles = 0;
  for (const Counts& f : files) {
    triangles += static_cast<double>(f.triangles);
    peak = std::max(peak,
                    in_file(triangles) + static_cast<double>(f.positions * 16 + f.normals * 12 + f.uvs * 8));
  }
  if (triangles <= kMostInMemory) return static_cast<uint64_t>(peak);
  double sample = triangles;  // the sample that checkpoints save
  while (sample > TriangleSample::kMost) sample /= 2;
  const double slice = std::min(triangles, static_cast<double>(kRoutedPerCheckpoint));
  const double routed = references * triangles * record;
  // A copy's three corners lie outside one of the regions that have the triangle.
  const double borders = std::max(references - 1, 0.0) * triangles * 3 * sizeof(BorderNormal);
  const double regions = routed * (routed > kLarge ? share : 1) + borders;
  return static_cast<uint64_t>(std::max(peak, in_file(triangles) - in_file(triangles - slice) + regions) +
                               sample * (sizeof(KdTriangle) + 4));
}

}  // namespace

namespace {

/// The cost by some of the regions that a run would make. Nothing: memory does not hold the vertices, or the
/// disk does not hold some regions, which a plan may be asked to find out.
Result<std::optional<SampleCost>> CostByRegions(const PreprocessOptions& options, CountingSink& counted,
                                                Attributes attributes) {
  if (!counted.held_all()) return std::optional<SampleCost>();
  if (counted.survey.triangles < kFewestTriangles) return std::optional(kUsualCost);
  PlannedRegions regions = PlanRegions(counted.survey);
  std::error_code unknown;
  const auto space = std::filesystem::space(SpillFolder(options), unknown);
  if (!unknown && space.available < 2 * KeptBytes(regions, attributes)) return std::optional<SampleCost>();
  QUARRY_ASSIGN(const TemporaryFolder folder,
                TemporaryFolder::Make(fmt::format("{}/quarry-plan-{}", SpillFolder(options), ::getpid())));
  RegionSink sink(options, MemoryForVertices(options), regions, attributes, folder.path());
  QUARRY_TRY(ReadModels(options, sink));
  sink.Release();
  if (!sink.held_all()) return std::optional<SampleCost>();
  QUARRY_ASSIGN(const SampleCost cost, sink.Measure());
  return std::optional(cost);
}

/// The cost by cubes around some vertices of the largest file.
Result<SampleCost> CostByWindows(const PreprocessOptions& options, const CountingSink& counted,
                                 size_t largest, Attributes attributes) {
  const Counts& of = counted.files[largest];
  const std::vector<SampleWindow> windows = ChooseWindows(of.vertices, of.triangles);
  WindowSink content(largest, windows, of.positions);
  QUARRY_TRY(ReadModels(options, content));
  CornerSink corners(largest, content);
  if (corners.wants_any()) QUARRY_TRY(ReadModels(options, corners));
  return MeasureWindows(options, windows, of.vertices, content, corners, attributes);
}

}  // namespace

Result<PreprocessPlan> MakePlan(const PreprocessOptions& options) {
  const TemporaryFile images(fmt::format("{}/quarry-images-{}", SpillFolder(options), ::getpid()));
  const ForeignImages foreign_images(ForeignPrefix(options));
  CountingSink counted(options, images.path());
  const auto start = Clock::now();
  QUARRY_TRY(ReadModels(options, counted));
  counted.Release();
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
  const Attributes attributes = uvs                 ? Attributes::kUvs
                                : normals           ? Attributes::kNormals
                                : counted.has_color ? Attributes::kColors
                                                    : Attributes::kNone;
  plan.has_shading = attributes != Attributes::kNone;
  QUARRY_ASSIGN(const std::optional<SampleCost> by_regions, CostByRegions(options, counted, attributes));
  SampleCost cost = by_regions.value_or(kUsualCost);
  if (!by_regions) {
    QUARRY_ASSIGN(cost, CostByWindows(options, counted, largest, attributes));
  }
  const auto triangles = static_cast<double>(plan.triangles);
  plan.store_bytes = static_cast<uint64_t>(triangles * cost.bytes);
  const auto record_bytes = static_cast<double>(RecordBytes(attributes));
  plan.spill_bytes = SpillPeak(counted.files, record_bytes, cost.spilled, cost.references);
  QUARRY_ASSIGN(const PlannedTextures textures, PlanTextures(options, counted.images));
  plan.texture_bytes = textures.stored_bytes;
  plan.store_bytes += plan.texture_bytes;
  plan.memory_bytes = options.memory + kOverheadBytes;
  // Each reference is routed and read once more.
  const double record_s =
      kImportSeconds + (plan.triangles > kMostInMemory ? kRoutingSeconds * cost.references : 0);
  plan.seconds = reading_s + triangles * (record_bytes * record_s + cost.seconds) + textures.seconds;
  return plan;
}

bool RoomIsTight(const PreprocessOptions& options) {
  namespace fs = std::filesystem;
  // Bytes of store and spill a byte of model: no format is terser than this, and packed files come near it.
  constexpr uint64_t kMostGrowth = 40;
  std::error_code error;
  uint64_t models = 0;
  for (const std::string& model : options.models) {
    const auto size = fs::file_size(model, error);
    if (error) return false;  // the run reports it; standard input cannot be read twice
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
  if (error) return {};  // the run reports the folders' faults
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

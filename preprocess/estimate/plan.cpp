#include "preprocess/estimate/plan.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <system_error>

#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/voxel/texture_shape.h"
#include "preprocess/import/ignoring_sink.h"
#include "preprocess/import/importer.h"
#include "preprocess/ingest/image_list.h"
#include "preprocess/partition/regions.h"
#include "preprocess/smooth/border_normals.h"
#include "preprocess/spill/temporary_file.h"
#include "preprocess/texture/row_converter.h"

namespace quarry {
namespace {

constexpr uint64_t kOverheadBytes = 44ull << 20;  // of a run beyond --memory: README.md, "Limits"

/// Costs of a triangle in measured scenes: tests/bench/history/preprocess.md.
struct Cost {
  double stored;      ///< bytes in the store, textures apart
  double share;       ///< of spilled bytes that stay after packing
  double references;  ///< regions that it lies in
};
constexpr Cost kLeast{0.1, 0.2, 1}, kUsual{14, 0.5, 1.05}, kMost{60, 1, 2};
constexpr double kSeconds = 3e-6;  // to build a triangle of usual scenes, on two threads

/// Counts the elements of models.
class CountingSink final : public IgnoringSink {
 public:
  /// `images_path`: the file for images that models hold as text.
  CountingSink(bool textures, std::string images_path)
      : images(std::move(images_path)), textures_(textures) {}
  Status BeginFile(std::string_view) override {
    files.emplace_back();
    return {};
  }
  bool takes_textures() const override { return textures_; }
  Result<uint32_t> AddTexture(TextureImage image) override { return images.Add(std::move(image)); }
  Status AddPosition(const glm::dvec3&, const Rgba8& color) override {
    ++files.back().positions;
    NoteColor(color);
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
  Status SetFaceColor(const Rgba8& color) override {
    NoteColor(color);
    return {};
  }
  Status AddPolygon(std::span<const Corner> corners, uint32_t, uint32_t) override {
    if (corners.size() >= 3) files.back().triangles += corners.size() - 2;
    return {};
  }

  struct Counts {
    uint64_t positions = 0, normals = 0, uvs = 0, triangles = 0;
  };
  std::vector<Counts> files;
  bool has_color = false;
  ImageList images;

 private:
  void NoteColor(const Rgba8& color) { has_color |= (color.r & color.g & color.b & color.a) != 255; }

  const bool textures_;
};

/// Removes, at its end, the images that came out of foreign models.
struct ForeignImages {
  explicit ForeignImages(std::string of) : prefix(std::move(of)) {}
  ForeignImages(const ForeignImages&) = delete;
  ~ForeignImages() { RemoveForeignImages(prefix); }
  std::string prefix;
};

/// Bytes of an image's texels in all levels; 0 if it cannot be read. Errors: the program that decodes images
/// is not there, or was killed.
Result<uint64_t> DecodedBytes(ImageDecoder& decoder, const TextureImage& image) {
  const Result<ImageFacts> facts = decoder.LookAt(image);
  if (!facts && decoder.is_fatal()) return tl::unexpected<Error>(facts.error());
  if (!facts) return 0;
  const TexelLayout layout = RowConverter(*facts, image.color, image.pick).layout();
  uint64_t bytes = 0;
  const TextureShape shape(layout.width, layout.height);
  for (const TextureShape::Level& level : shape.levels())
    bytes += uint64_t{level.width} * level.height * layout.texel_bytes();
  return bytes;
}

/// Most bytes of spill at any time: while a file is imported, or when all triangles have been routed. In the
/// second case a slice of triangles lies in both places, and a triangle in several regions lies in each.
/// Units: `record` in bytes of a triangle.
uint64_t SpillPeak(const std::vector<CountingSink::Counts>& files, double record, const Cost& cost) {
  constexpr auto kLarge = static_cast<double>(SpillFile::kPackLarge);
  // The triangle file is packed beyond its first bytes; regions' files are packed entirely or not at all.
  const auto in_file = [&](double n) {
    return std::min(n * record, kLarge) + std::max(n * record - kLarge, 0.0) * cost.share;
  };
  double peak = 0, triangles = 0;
  for (const auto& f : files) {
    triangles += static_cast<double>(f.triangles);
    peak = std::max(peak,
                    in_file(triangles) + static_cast<double>(f.positions * 16 + f.normals * 12 + f.uvs * 8));
  }
  if (triangles <= kMostInMemory) return static_cast<uint64_t>(peak);
  double sample = triangles;  // the sample that checkpoints save
  while (sample > TriangleSample::kMost) sample /= 2;
  const double slice = std::min(triangles, static_cast<double>(kRoutedPerCheckpoint));
  const double routed = cost.references * triangles * record;
  // A copy's three corners lie outside one of the regions that have the triangle.
  const double borders = std::max(cost.references - 1, 0.0) * triangles * 3 * sizeof(BorderNormal);
  const double regions = routed * (routed > kLarge ? cost.share : 1) + borders;
  return static_cast<uint64_t>(std::max(peak, in_file(triangles) - in_file(triangles - slice) + regions) +
                               sample * (sizeof(KdTriangle) + 4));
}

}  // namespace

Result<PreprocessPlan> MakePlan(const PreprocessOptions& options) {
  const TemporaryFile images(fmt::format("{}/quarry-images-{}", SpillFolder(options), ::getpid()));
  const ForeignImages foreign(fmt::format("{}/quarry-foreign-{}", SpillFolder(options), ::getpid()));
  CountingSink counted(options.textures, images.path());
  const auto start = std::chrono::steady_clock::now();
  for (const std::string& model : options.models)
    QUARRY_TRY(ImportModel(model, counted, ForeignFormatsOf(options, foreign.prefix), options.unpack_limit,
                           GltfDecodingOf(options, SpillFolder(options)),
                           CadReadingOf(options, SpillFolder(options))));
  PreprocessPlan plan;
  plan.seconds = SecondsSince(start);
  uint64_t normals = 0, uvs = 0;
  for (const auto& file : counted.files) {
    plan.triangles += file.triangles;
    plan.vertices += file.positions;
    normals += file.normals;
    uvs += file.uvs;
  }
  const Attributes attributes = uvs                 ? Attributes::kUvs
                                : normals           ? Attributes::kNormals
                                : counted.has_color ? Attributes::kColors
                                                    : Attributes::kNone;
  plan.has_shading = attributes != Attributes::kNone;
  QUARRY_ASSIGN(const std::vector<TextureImage> list, counted.images.Finish());
  ImageDecoder decoder(ImageDecodingOf(options));
  for (const TextureImage& image : list) {
    QUARRY_ASSIGN(const uint64_t bytes, DecodedBytes(decoder, image));
    plan.texture_bytes += bytes;
  }
  const auto triangles = static_cast<double>(plan.triangles);
  const auto record = static_cast<double>(RecordBytes(attributes));
  const auto spill = [&](const Cost& cost) { return SpillPeak(counted.files, record, cost); };
  const auto store = [&](const Cost& cost) { return static_cast<uint64_t>(triangles * cost.stored); };
  plan.spill = {spill(kLeast), spill(kUsual), spill(kMost)};
  // How well an image packs is not known: from not at all to nearly to nothing.
  plan.store = {store(kLeast), store(kUsual) + plan.texture_bytes / 2, store(kMost) + plan.texture_bytes};
  plan.memory_bytes = options.memory + kOverheadBytes;
  plan.seconds += triangles * kSeconds;
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

Result<std::string> CheckRoom(const PreprocessOptions& options, const PreprocessPlan& plan) {
  namespace fs = std::filesystem;
  std::error_code error;
  const fs::path store = fs::path(options.output).parent_path(), spill = SpillFolder(options);
  const auto store_space = fs::space(store.empty() ? "." : store, error),
             spill_space = fs::space(spill, error);
  if (error) return "";  // the run reports the folders' faults
  const bool same = store_space.capacity == spill_space.capacity && store_space.free == spill_space.free;
  // The store grows while spill shrinks.
  const auto both = [](uint64_t spilled, uint64_t stored) { return std::max(spilled + stored / 4, stored); };
  const ByteEstimate wanted =
      same ? ByteEstimate{both(plan.spill.least, plan.store.least), both(plan.spill.usual, plan.store.usual),
                          both(plan.spill.most, plan.store.most)}
           : plan.spill;
  const auto text = [&](const std::string& place, const ByteEstimate& need, const char* use, uint64_t free) {
    return fmt::format("{}: about {} are needed for {}, between {} and {}, and {} are free", place,
                       FormatSize(need.usual), use, FormatSize(need.least), FormatSize(need.most),
                       FormatSize(free));
  };
  const std::string short_spill =
      text(spill.string(), wanted, same ? "spill and the store" : "spill", spill_space.available) +
      "; --tmp names another folder";
  const std::string short_store = text(options.output, plan.store, "the store", store_space.available);
  if (wanted.least > spill_space.available) return Fail(short_spill);
  if (!same && plan.store.least > store_space.available) return Fail(short_store);
  if (wanted.most > spill_space.available) return short_spill;
  if (!same && plan.store.most > store_space.available) return short_store;
  return "";
}

}  // namespace quarry

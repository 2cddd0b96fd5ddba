#include "deploy/command/rays/rays_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstring>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "common/api/calls.h"
#include "common/api/open_scenes.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/number.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/size.h"
#include "common/remote/open_store.h"
#include "deploy/command/model_cache.h"
#include "deploy/command/rays/npy.h"
#include "deploy/command/rays/ray_window.h"

namespace quarry {
namespace {

constexpr const char* kInput = "standard input";
constexpr const char* kHitType =
    "('t', '<f8'), ('triangle', '<u4'), ('part', '<u4'), ('material', '<u4'), ('uv', '<f4', (2,)), "
    "('normal', '<f4', (3,))";
const OutputKind kNpyOutput{"an .npy file",
                            [](std::string_view start) { return start.starts_with("\x93NUMPY"); }, false};

/// Bytes of memory for a ray of a window: numbers, read and sorted, its place, its hit and the hit's row.
constexpr uint64_t kRayBytes = 8 * 8 * 3 + 16 + 44 + 40;
/// The same for a hit of --all.
constexpr uint64_t kHitBytes = 44 + 48;

Error ErrorOf(quarry_status status) {
  const char* const sentence = api::Sentence();
  switch (status) {
    case QUARRY_ARGUMENT:
      return {sentence, ErrorKind::kUsage};
    case QUARRY_CANCELLED:
      return {sentence, ErrorKind::kCancelled};
    default:
      return {sentence};
  }
}

Status Check(quarry_status status) {
  if (status == QUARRY_OK) return {};
  return tl::unexpected<Error>(ErrorOf(status));
}

/// Arrays for hits, as quarry.h fills them.
struct HitArrays {
  void Resize(size_t n) {
    t.resize(n);
    triangle.resize(n);
    part.resize(n);
    material.resize(n);
    uv.resize(2 * n);
    normal.resize(3 * n);
  }
  quarry_hits Named() {
    quarry_hits hits = QUARRY_HITS_INIT;
    hits.t = t.data();
    hits.triangle = triangle.data();
    hits.uv = uv.data();
    hits.part = part.data();
    hits.material = material.data();
    hits.normal = normal.data();
    return hits;
  }
  /// Appends entry `i` as a row of kHitType.
  void Put(size_t i, std::byte* row) const {
    const auto put = [&](const void* from, size_t bytes) {
      std::memcpy(row, from, bytes);
      row += bytes;
    };
    put(&t[i], sizeof t[i]);
    put(&triangle[i], 4);
    put(&part[i], 4);
    put(&material[i], 4);
    put(&uv[2 * i], 8);
    put(&normal[3 * i], 12);
  }
  static constexpr size_t kRowBytes = 40;

  std::vector<double> t;
  std::vector<uint32_t> triangle, part, material;
  std::vector<float> uv, normal;
};

/// The output: a file that appears whole, or standard output.
class Output {
 public:
  static Result<Output> Open(const RaysArguments& arguments) {
    Output output;
    if (arguments.output.empty()) {
      if (::isatty(STDOUT_FILENO)) return BadUsage("give -o hits.npy, or send standard output to a file");
      return output;
    }
    OutputGuard guard(arguments.force ? OutputGuard::Force::kYes : OutputGuard::Force::kNo);
    guard.AddInput(arguments.scene);
    guard.AddInput("/dev/stdin");
    QUARRY_ASSIGN(const OutputPlace place, guard.Take(arguments.output, kNpyOutput));
    QUARRY_ASSIGN(OutputFile file, OutputFile::Create(place.path));
    output.file_.emplace(std::move(file));
    return output;
  }
  Status Write(std::span<const std::byte> bytes) {
    if (file_) return file_->Write(bytes);
    PrintRaw({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
    return {};
  }
  /// Replaces the header and makes the file appear.
  Status Finish(const std::string& header) {
    if (!file_) return {};
    QUARRY_TRY(file_->WriteAt(0, std::as_bytes(std::span(header))));
    return file_->Commit();
  }

 private:
  std::optional<OutputFile> file_;
};

/// Answers windows of rays.
class Asker {
 public:
  Asker(const RaysArguments& arguments, quarry_scene* scene, Output& output, uint64_t memory)
      : arguments_(arguments),
        scene_(scene),
        output_(output),
        memory_(memory),
        flags_(arguments.glass == "pass" ? QUARRY_GLASS_PASSES : 0) {}

  /// NumPy's type of the output's entries.
  std::string Type() const {
    if (arguments_.any) return "'|b1'";
    if (arguments_.count) return "'<u4'";
    return fmt::format("[{}{}]", arguments_.all ? "('ray', '<u8'), " : "", kHitType);
  }
  /// Rows written so far.
  uint64_t rows() const { return rows_; }

  /// Answers a window whose first ray is row `first_row` of the input.
  Status Answer(const RayWindow& window, uint64_t first_row) {
    first_window_ = window.size();
    if (arguments_.all) return All(window, first_row);
    rows_ += window.size();
    if (arguments_.any) return Any(window);
    return arguments_.count ? Count(window) : Nearest(window);
  }

 private:
  Status Any(const RayWindow& window) {
    const quarry_rays rays = window.Sorted(flags_);
    std::vector<uint8_t> hit(window.size());
    QUARRY_TRY(Check(api::Any(scene_, &rays, hit.data())));
    out_.resize(window.size());
    for (size_t i = 0; i < hit.size(); ++i) out_[window.PlaceOf(i)] = static_cast<std::byte>(hit[i]);
    return output_.Write(out_);
  }
  Status Count(const RayWindow& window) {
    const quarry_rays rays = window.Sorted(flags_);
    std::vector<uint32_t> counts(window.size());
    QUARRY_TRY(Check(api::Count(scene_, &rays, counts.data())));
    out_.resize(window.size() * sizeof(uint32_t));
    for (size_t i = 0; i < counts.size(); ++i)
      std::memcpy(out_.data() + window.PlaceOf(i) * sizeof(uint32_t), &counts[i], sizeof(uint32_t));
    return output_.Write(out_);
  }
  Status Nearest(const RayWindow& window) {
    const quarry_rays rays = window.Sorted(flags_);
    hits_.Resize(window.size());
    const quarry_hits named = hits_.Named();
    QUARRY_TRY(Check(api::Nearest(scene_, &rays, &named)));
    out_.resize(window.size() * HitArrays::kRowBytes);
    for (size_t i = 0; i < window.size(); ++i)
      hits_.Put(i, out_.data() + window.PlaceOf(i) * HitArrays::kRowBytes);
    return output_.Write(out_);
  }
  /// Counts the window's hits, and halves the window while memory has no room for them.
  Status All(const RayWindow& window, uint64_t first_row) {
    const quarry_rays rays = window.Sorted(flags_);
    std::vector<uint32_t> counts(window.size());
    QUARRY_TRY(Check(api::Count(scene_, &rays, counts.data())));
    std::vector<uint64_t> ends(window.size() + 1);  // by place in the window
    for (size_t i = 0; i < counts.size(); ++i) ends[window.PlaceOf(i) + 1] = counts[i];
    for (size_t i = 0; i < counts.size(); ++i) ends[i + 1] += ends[i];
    // Halves hold rays of their own beside those of the whole.
    const uint64_t of_rays = 2 * kRayBytes * first_window_;
    const uint64_t most = (memory_ > 2 * of_rays ? memory_ - of_rays : memory_ / 2) / (2 * kHitBytes);
    if (ends.back() <= most || window.size() == 1) return AllOf(window, first_row, counts, ends);
    const size_t half = window.size() / 2;
    QUARRY_TRY(All(window.Part(0, half), first_row));
    return All(window.Part(half, window.size() - half), first_row + half);
  }
  Status AllOf(const RayWindow& window, uint64_t first_row, const std::vector<uint32_t>& counts,
               const std::vector<uint64_t>& ends) {
    constexpr size_t kRow = sizeof(uint64_t) + HitArrays::kRowBytes;
    const quarry_rays rays = window.Sorted(flags_);
    std::vector<uint64_t> splits(counts.size() + 1, 0);
    for (size_t i = 0; i < counts.size(); ++i) splits[i + 1] = splits[i] + counts[i];
    hits_.Resize(splits.back());
    const quarry_hits named = hits_.Named();
    QUARRY_TRY(Check(api::All(scene_, &rays, splits.data(), &named)));
    out_.resize(splits.back() * kRow);
    for (size_t i = 0; i < counts.size(); ++i) {
      const uint64_t ray = first_row + window.PlaceOf(i);
      std::byte* row = out_.data() + ends[window.PlaceOf(i)] * kRow;
      for (uint64_t k = splits[i]; k < splits[i + 1]; ++k, row += kRow) {
        std::memcpy(row, &ray, sizeof ray);
        hits_.Put(k, row + sizeof ray);
      }
    }
    rows_ += splits.back();
    return output_.Write(out_);
  }

  const RaysArguments& arguments_;
  quarry_scene* const scene_;
  Output& output_;
  const uint64_t memory_;
  const uint32_t flags_;
  HitArrays hits_;
  Bytes out_;
  uint64_t rows_ = 0, first_window_ = 0;
};

/// Closes a scene at the end.
struct SceneCloser {
  explicit SceneCloser(quarry_scene* opened) : scene(opened) {}
  ~SceneCloser() { api::Close(scene); }
  SceneCloser(const SceneCloser&) = delete;
  quarry_scene* const scene;
};

Result<quarry_scene*> OpenFor(const RaysArguments& arguments) {
  quarry_options options = QUARRY_OPTIONS_INIT;
  QUARRY_ASSIGN(options.cache_bytes, ParseSize(arguments.cache, "--cache"));
  options.threads = arguments.threads;
  QUARRY_ASSIGN(const HttpOptions http, ReadRemoteArguments(arguments.remote));
  std::string place = arguments.scene;
  if (!IsRemote(place)) {
    QUARRY_ASSIGN(place, StoreFor(place, {}, arguments.quiet));
  }
  QUARRY_ASSIGN(auto scene, api::OpenScene::Open(place, options, http));
  return api::OpenScenes::OfThisProcess().Add(std::move(scene));
}

}  // namespace

void AddRaysOptions(CLI::App& command, RaysArguments& a) {
  command
      .add_option(
          "scene", a.scene,
          "The store: a file, or https://... or s3://BUCKET/KEY; or a model, which is preprocessed first")
      ->required();
  command.add_option("-o,--output", a.output, "The .npy file of the answers (default: standard output)");
  auto* const any = command.add_flag("--any", a.any, "Whether each ray hits anything: bool");
  auto* const count =
      command.add_flag("--count", a.count, "How many hits each ray has: uint32")->excludes(any);
  command.add_flag("--all", a.all, "All hits of each ray, by t, with the ray's row as `ray`; needs -o")
      ->excludes(any)
      ->excludes(count);
  command.add_option("--glass", a.glass, "surface; pass: materials that let light through are none")
      ->check(CLI::IsMember({"surface", "pass"}))
      ->capture_default_str();
  command.add_option("--cache", a.cache, "Memory for decoded voxels")->capture_default_str();
  command.add_option("--memory", a.memory, "Memory for rays and hits, beside the cache")
      ->capture_default_str();
  command.add_option("--threads", a.threads, "Threads (default: all processors)")
      ->check(WholeNumber(1, 4096));
  AddRemoteOptions(command, a.remote);
  command.add_flag("--force", a.force, "Replace an output of another kind too, but never an input");
  command.add_flag("--quiet", a.quiet, "Print errors only");
  command.footer(
      "Rays come on standard input as an .npy file: rows of 6 float32 or float64, origin and direction, or "
      "of 8, with tnear and tfar after them.\n"
      "Answers have the rays' order. t counts lengths of the direction; ids of misses are 4294967295.\n\n"
      "Examples:\n  quarry rays plant.quarry -o hits.npy < rays.npy\n  quarry rays plant.quarry --any < "
      "rays.npy > shaded.npy\n"
      "  quarry rays s3://models/plant.quarry --all -o hits.npy --cache 4G < rays.npy");
}

Status RunRays(const RaysArguments& arguments) {
  if (arguments.all && arguments.output.empty())
    return BadUsage("--all needs -o: the number of hits, which begins the file, is known at the end");
  QUARRY_ASSIGN(const uint64_t memory, ParseSize(arguments.memory, "--memory"));
  // With --all a window's hits share the memory: three a ray are expected. Its arrays may hold twice what
  // they need.
  const uint64_t ray_bytes = arguments.all ? 2 * (kRayBytes + 3 * kHitBytes) : kRayBytes;
  const uint64_t most = std::min<uint64_t>(memory / ray_bytes, 1u << 24);
  if (most < 512)
    return BadUsage(fmt::format("--memory of {} is too little; give at least 1M", FormatSize(memory)));
  QUARRY_ASSIGN(NpyReader input, NpyReader::Open(STDIN_FILENO, kInput));
  QUARRY_ASSIGN(Output output, Output::Open(arguments));
  QUARRY_ASSIGN(quarry_scene* const opened, OpenFor(arguments));
  const SceneCloser closer(opened);
  Asker asker(arguments, closer.scene, output, memory);
  const std::string header = NpyHeader(asker.Type(), input.shape().rows);
  QUARRY_TRY(output.Write(std::as_bytes(std::span(header))));
  Progress progress(arguments.quiet);
  progress.Begin("tracing rays");
  RayWindow window;
  for (uint64_t row = 0; row < input.shape().rows;) {
    const uint64_t rows = std::min(most, input.rows_left());
    QUARRY_TRY(window.Read(input, kInput, row, rows));
    QUARRY_TRY(asker.Answer(window, row));
    row += rows;
    progress.Update(row, input.shape().rows);
  }
  QUARRY_TRY(input.CheckEnd());
  progress.End();
  return output.Finish(NpyHeader(asker.Type(), asker.rows()));
}

}  // namespace quarry

#include "preprocess/preprocess.h"

#include <fmt/format.h>

#include <chrono>
#include <memory>
#include <optional>
#include <thread>
#include <utility>

#include "common/base/cleanup.h"
#include "common/base/file_lock.h"
#include "common/base/output_path.h"
#include "common/base/progress.h"
#include "common/base/resource.h"
#include "common/base/version.h"
#include "common/voxel/store_header.h"
#include "common/voxel/voxel_block.h"
#include "preprocess/build_stage.h"
#include "preprocess/environment/environment_stage.h"
#include "preprocess/import/importer.h"
#include "preprocess/import_stage.h"
#include "preprocess/work_folder.h"

namespace quarry {
namespace {

using Clock = std::chrono::steady_clock;

/// Version of the journal's checkpoints, and of everything a store depends on that no option states.
constexpr int kJournalVersion = 12;

/// The options that a store depends on, a line each, as the journal keeps them.
std::string Command(const PreprocessOptions& options) {
  std::string command = fmt::format(
      "version {}\nformat {}\nimport {}\njournal {}\nLZ4 {}\n--tmp {}\n--voxel-size {}\n--scale {}\n--up "
      "{}\n--crease {}\n--deflection {},{}\n{}",
      kVersion, kStoreVersion, kImportVersion, kJournalVersion, CompressorVersion(), options.tmp_folder,
      options.voxel_size, options.scale,
      options.up_axis == 0   ? "guessed"
      : options.up_axis == 1 ? "y"
                             : "z",
      options.crease, options.linear_deflection, options.angular_deflection,
      options.textures ? "" : "--no-textures\n");
  for (const auto& [model, p] : options.placements)
    command += fmt::format("--place {}={},{},{},{},{}\n", model, p.translation.x, p.translation.y,
                           p.translation.z, p.turn_degrees, p.scale);
  return command;
}

/// A work folder and the import in it, continued from the journal.
struct Begun {
  WorkFolder work;
  std::unique_ptr<ImportStage> import;
};

Result<std::unique_ptr<Begun>> Begin(const PreprocessOptions& options, bool resume, Progress& progress) {
  QUARRY_ASSIGN(WorkFolder work, WorkFolder::Open(options.output, options.tmp_folder, Command(options),
                                                  resume, options.goes_on));
  auto begun = std::make_unique<Begun>(Begun{std::move(work), nullptr});
  begun->import = std::make_unique<ImportStage>(options, begun->work, progress);
  QUARRY_TRY(begun->import->Restore());
  return begun;
}

/// Textures have no place on models without uv: whether a triangle has any would depend on its voxel.
void DropTexturesWithoutUv(ImportedScene& scene, Progress& progress) {
  if (scene.attributes >= Attributes::kUvs || scene.images.empty()) return;
  scene.images.clear();
  for (Material& material : scene.materials) material.textures.clear();
  scene.warnings.emplace_back("no vertex has texture coordinates; the textures of materials are left out");
  progress.Say("warning: " + scene.warnings.back());
}

Result<PreprocessStatistics> RunIn(Begun& begun, const PreprocessOptions& options, Progress& progress) {
  const auto start = Clock::now();
  QUARRY_ASSIGN(ImportedScene scene, begun.import->Run());
  begun.import.reset();
  QUARRY_TRY(CheckNotRead(options.output));  // the models' other files are known only now
  PreprocessStatistics statistics;
  statistics.import_wall_s = SecondsSince(start);
  DropTexturesWithoutUv(scene, progress);
  statistics.warnings = scene.warnings.size();
  statistics.notes = scene.notes;
  const auto build_start = Clock::now();
  BuildStage build(options, begun.work, progress, scene);
  QUARRY_TRY(build.Run());
  QUARRY_TRY(build.Finish(statistics));
  progress.EndStages();
  statistics.build_wall_s = SecondsSince(build_start);
  statistics.preprocess_wall_s = SecondsSince(start);
  statistics.peak_rss_bytes = PeakResidentBytes();
  return statistics;
}

/// Locks the output. Whoever starts this program for `quarry render` holds a lock of its own: another holder
/// can only be a killed run, which has it until the system is done with its memory.
Result<FileLock> TakeOutput(const PreprocessOptions& options) {
  constexpr const char* kOther = "another quarry-preprocess";
  constexpr std::chrono::milliseconds kPatience{30000}, kPause{50};
  if (options.resume != PreprocessOptions::Resume::kIfFit) return FileLock::Take(options.output, kOther);
  for (const auto end = Clock::now() + kPatience; Clock::now() < end; std::this_thread::sleep_for(kPause)) {
    QUARRY_ASSIGN(std::optional<FileLock> lock, FileLock::TryTake(options.output));
    if (lock) return std::move(*lock);
  }
  return FileLock::Take(options.output, kOther);
}

}  // namespace

Result<PreprocessStatistics> Preprocess(const PreprocessOptions& options) {
  // The output first: an unwritable place must not cost an import.
  QUARRY_ASSIGN(const FileLock lock, TakeOutput(options));
  using Resume = PreprocessOptions::Resume;
  Progress progress(options.quiet);
  if (IsEnvironment(options)) {
    auto made = MakeEnvironment(options, progress);
    if (made) PrintOnSignal(options.output + " is written");
    return made;
  }
  auto opened = Begin(options, options.resume != Resume::kNo, progress);
  if (!opened && options.resume == Resume::kIfFit) opened = Begin(options, false, progress);
  if (!opened) return tl::unexpected<Error>(opened.error());
  Begun& begun = **opened;
  auto statistics = RunIn(begun, options, progress);
  if (statistics) {
    begun.work.Remove();
    PrintOnSignal(options.output + " is written");
  } else if (begun.work.kept() && statistics.error().kind != ErrorKind::kCannotResume)
    statistics.error().message +=
        fmt::format("; the finished part is kept in {}: {}", begun.work.path(), options.goes_on);
  return statistics;
}

}  // namespace quarry

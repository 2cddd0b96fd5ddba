#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "common/base/cleanup.h"
#include "common/base/file.h"
#include "common/base/log.h"
#include "common/base/number.h"
#include "common/base/output_path.h"
#include "common/base/resource.h"
#include "common/base/size.h"
#include "common/base/version.h"
#include "common/command_line/command_line.h"
#include "common/program/run_program.h"
#include "common/program/version_text.h"
#include "common/voxel/store_header.h"
#include "preprocess/environment/environment_stage.h"
#include "preprocess/estimate/plan.h"
#include "preprocess/import/decompressor.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/import/text/text_number.h"
#include "preprocess/preprocess.h"

namespace quarry {
namespace {

/// Options that are parsed after all of them are known.
struct Texts {
  std::string memory = "1G", voxel_size = "256K", up, stats, unpack_limit, deflection;
  std::vector<std::string> places;
  bool force = false;
};

constexpr uint64_t kLeastMemory = 64ull << 20;
constexpr uint64_t kLeastVoxel = 4u << 10, kLargestVoxel = 4u << 20;

uint64_t Kept(const PreprocessStatistics& s) { return s.meta.kept_triangles(); }

double Replication(const PreprocessStatistics& s) {
  return static_cast<double>(s.stored_references) / static_cast<double>(std::max<uint64_t>(Kept(s), 1));
}

std::string StatisticsJson(const PreprocessOptions& options, const PreprocessStatistics& s) {
  nlohmann::ordered_json j;
  j["scene_id"] = FormatSceneId(s.scene_id);
  j["input_triangles"] = s.meta.input_triangles;
  j["dropped_degenerate_triangles"] = s.meta.dropped_degenerate;
  j["dropped_not_finite_triangles"] = s.meta.dropped_not_finite;
  j["dropped_transparent_triangles"] = s.meta.dropped_transparent;
  j["opacity_masks"] = s.meta.masks;
  j["voxels"] = s.voxels;
  j["stored_triangle_references"] = s.stored_references;
  j["replication"] = Replication(s);
  j["top_tree_nodes"] = s.top_tree_nodes;
  j["top_tree_depth"] = s.top_tree_depth;
  j["voxel_size_bytes"] = s.meta.voxel_size;
  j["textures"] = s.textures.textures;
  j["images_left_out"] = s.textures.left_out;
  j["texture_pages"] = s.textures.pages;
  j["texture_stored_bytes"] = s.textures.stored_bytes;
  j["texture_decoded_bytes"] = s.textures.decoded_bytes;
  j["texture_wall_s"] = s.textures.wall_s;
  j["up_axis"] = s.meta.up_axis == 1 ? "y" : "z";
  j["up_axis_guessed"] = options.up_axis == 0;
  if (options.up_axis == 0)
    j["up_axis_sureness"] = kSurenessNames[static_cast<int>(SurenessOf(s.up_evidence, options.up_habit))];
  j["store_bytes"] = s.store_bytes;
  j["warnings"] = s.warnings;
  j["notes"] = s.notes;
  j["import_wall_s"] = s.import_wall_s;
  j["build_wall_s"] = s.build_wall_s;
  j["preprocess_wall_s"] = s.preprocess_wall_s;
  j["version"] = kVersion;
  j["host"] = HostName();
  j["triangles_per_s"] = static_cast<double>(s.meta.input_triangles) / std::max(s.preprocess_wall_s, 1e-9);
  j["peak_rss_bytes"] = s.peak_rss_bytes;
  j["models"] = nlohmann::ordered_json::array();
  for (const std::string& model : options.models)
    j["models"].push_back(model == "-" ? model : std::filesystem::absolute(model).string());
  j["inputs"] = nlohmann::ordered_json::array();
  for (const ModelFile& file : ModelFiles()) {
    nlohmann::ordered_json input = {{"file", file.path}, {"there", file.there}};
    if (file.there)
      input.update({{"bytes", file.bytes},
                    {"changed_ns", file.changed_ns},
                    {"status_changed_ns", file.status_changed_ns}});
    j["inputs"].push_back(std::move(input));
  }
  return j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) + "\n";
}

/// The scene's name for the user.
std::string NameOf(const PreprocessOptions& options) {
  if (options.models.size() > 1) return fmt::format("{} models", options.models.size());
  return options.models[0] == "-" ? "standard input" : options.models[0];
}

void PrintSummary(const PreprocessOptions& options, const PreprocessStatistics& s) {
  if (IsEnvironment(options))
    return Log(
        fmt::format("{}: an environment in {} pages, {} stored, {} once decoded; {:.1f} s, peak memory {}",
                    NameOf(options), s.textures.pages, FormatSize(s.store_bytes),
                    FormatSize(s.textures.decoded_bytes), s.preprocess_wall_s, FormatSize(s.peak_rss_bytes)));
  Log(
      fmt::format("{}: {} triangles in {} voxels, {} ({:.1f} bytes a triangle)\n"
                  "replication {:.2f}, top-level tree {} levels deep; {:.1f} s ({:.2f} million triangles a "
                  "second), peak memory {}",
                  NameOf(options), Kept(s), s.voxels, FormatSize(s.store_bytes),
                  static_cast<double>(s.store_bytes - s.textures.stored_bytes) /
                      static_cast<double>(std::max<uint64_t>(Kept(s), 1)),
                  Replication(s), s.top_tree_depth, s.preprocess_wall_s,
                  static_cast<double>(s.meta.input_triangles) / std::max(s.preprocess_wall_s, 1e-9) * 1e-6,
                  FormatSize(s.peak_rss_bytes)));
  for (const std::string& note : s.notes) Log(note);
  if (options.up_axis == 0) Log(GuessText(s.meta.up_axis, s.up_evidence, options.up_habit));
  if (s.textures.textures > 0)
    Log(fmt::format("{} textures in {} pages, {} stored, {} once decoded", s.textures.textures,
                    s.textures.pages, FormatSize(s.textures.stored_bytes),
                    FormatSize(s.textures.decoded_bytes)));
  if (s.meta.dropped_degenerate + s.meta.dropped_not_finite > 0)
    Log(fmt::format("dropped: {} triangles without area, {} with coordinates that are not finite",
                    s.meta.dropped_degenerate, s.meta.dropped_not_finite));
  if (s.meta.dropped_transparent > 0)
    Log(fmt::format("dropped: {} triangles that opacity textures cut out completely",
                    s.meta.dropped_transparent));
}

/// "MODEL=x,y,z[,turn[,scale]]"
Status ParsePlacement(const std::string& text, PreprocessOptions& options) {
  const auto wrong = [&](const char* what) { return BadUsage(fmt::format("--place {}: {}", text, what)); };
  const size_t equals = text.rfind('=');
  if (equals == std::string::npos) return wrong("expected MODEL=x,y,z[,turn[,scale]]");
  const std::string model = text.substr(0, equals);
  if (std::ranges::find(options.models, model) == options.models.end())
    return wrong("the model must be one of the given models, spelt the same");
  std::string list = text.substr(equals + 1);
  std::ranges::replace(list, ',', ' ');
  TextCursor cursor(list);
  double values[5] = {0, 0, 0, 0, 1};
  int count = 0;
  for (; count < 5 && !cursor.AtEnd(); ++count)
    if (!ParseReal(cursor, values[count]) || !(std::abs(values[count]) < 1e15))
      return wrong("expected five numbers at most");
  if (count < 3 || !cursor.AtEnd()) return wrong("expected three to five numbers");
  if (!(values[4] > 0)) return wrong("the scale must be positive");
  options.placements[model] = {values[4], values[3], {values[0], values[1], values[2]}};
  return {};
}

/// "LINEAR[,ANGLE]"
Status ParseDeflection(std::string text, PreprocessOptions& options) {
  if (text.empty()) return {};
  const auto wrong = [&](const char* what) {
    return BadUsage(fmt::format("--deflection {}: {}", text, what));
  };
  std::string list = text;
  std::ranges::replace(list, ',', ' ');
  TextCursor cursor(list);
  double linear = 0, angle = 0;
  if (!ParseReal(cursor, linear) || !(linear > 0 && linear < 1e15))
    return wrong("expected a positive distance, in the model's unit");
  if (!cursor.AtEnd() && (!ParseReal(cursor, angle) || !(angle >= 1 && angle <= 90) || !cursor.AtEnd()))
    return wrong("expected an angle of 1 to 90 degrees after the distance, and nothing more");
  options.linear_deflection = linear;
  options.angular_deflection = angle;
  return {};
}

/// Refuses a run for which the disk has no room, and warns where the room may not suffice.
Status CheckRoomFor(const PreprocessOptions& options, const PreprocessPlan& plan) {
  QUARRY_ASSIGN(const std::string warning, CheckRoom(options, plan));
  if (!warning.empty()) Log("warning: " + warning);
  return {};
}

Status PrintPlan(const PreprocessOptions& options, const std::string& stats) {
  QUARRY_ASSIGN(const PreprocessPlan plan, MakePlan(options));
  if (!options.quiet)
    Print(fmt::format(
        "{} triangles, {} vertices{}\n  spill     about {}, {} at most, in {}\n"
        "  store     about {}, {} at most\n{}  memory    {} at most\n  time      about {:.0f} s on two "
        "cores\n",
        plan.triangles, plan.vertices, plan.has_shading ? ", with normals, uv or colours" : "",
        FormatSize(plan.spill.usual), FormatSize(plan.spill.most), SpillFolder(options),
        FormatSize(plan.store.usual), FormatSize(plan.store.most),
        plan.texture_bytes ? fmt::format("  textures  {} of it at most\n", FormatSize(plan.texture_bytes))
                           : "",
        FormatSize(plan.memory_bytes), plan.seconds));
  if (!stats.empty()) {
    const nlohmann::ordered_json j = {{"input_triangles", plan.triangles},
                                      {"input_vertices", plan.vertices},
                                      {"spill_bytes", plan.spill.usual},
                                      {"spill_bytes_most", plan.spill.most},
                                      {"store_bytes", plan.store.usual},
                                      {"store_bytes_most", plan.store.most},
                                      {"texture_decoded_bytes", plan.texture_bytes},
                                      {"peak_rss_bytes", plan.memory_bytes},
                                      {"preprocess_wall_s", plan.seconds}};
    QUARRY_TRY(WriteFileAtomically(stats, AsBytes(j.dump(2) + "\n")));
  }
  return CheckRoomFor(options, plan);
}

bool IsStore(std::string_view start) { return start.starts_with(kStoreMagic); }
const OutputKind kStoreOutput{"a scene store", IsStore, false};

Status TakeStatistics(const Texts& texts, OutputGuard& guard) {
  QUARRY_ASSIGN(const OutputPlace stats, guard.Take(texts.stats, kStatisticsOutput));
  return CheckWritable(stats);
}

/// Decides all outputs before any work. The store's final place replaces options.output: the work folder lies
/// beside it.
Status CheckOutputs(const Texts& texts, PreprocessOptions& options) {
  OutputGuard guard(texts.force ? OutputGuard::Force::kYes : OutputGuard::Force::kNo);
  for (const std::string& model : options.models) guard.AddInput(model);
  if (options.output.empty()) return texts.stats.empty() ? Status{} : TakeStatistics(texts, guard);
  QUARRY_ASSIGN(const OutputPlace store, guard.Take(options.output, kStoreOutput));
  options.output = store.path;
  QUARRY_TRY(OutputGuard::TakeFolder(BesidePath(options.output, ".work")));
  if (!options.tmp_folder.empty()) QUARRY_TRY(OutputGuard::TakeFolder(options.tmp_folder));
  return texts.stats.empty() ? Status{} : TakeStatistics(texts, guard);
}

/// An image alone makes an environment; beside models it is a mistake.
Status CheckImages(const PreprocessOptions& options, const Texts& texts) {
  if (IsEnvironment(options)) {
    const std::pair<const char*, bool> given[] = {
        {"--scale", options.scale != 1},
        {"--up-axis", !texts.up.empty()},
        {"--place", !texts.places.empty()},
        {"--deflection", !texts.deflection.empty()},
        {"--voxel-size", texts.voxel_size != Texts().voxel_size},
        {"--resume", options.resume == PreprocessOptions::Resume::kYes}};
    for (const auto& [option, is_given] : given)
      if (is_given) return BadUsage(fmt::format("{} has no effect on an image; leave it out", option));
  }
  if (options.models.size() < 2) return {};
  for (const std::string& model : options.models)
    if (PreprocessOptions alone{.models = {model}}; IsEnvironment(alone))
      return BadUsage(fmt::format(
          "{}: is an image, which makes an environment, a store of its own; give it alone", model));
  return {};
}

Status Run(PreprocessOptions options, const Texts& texts, bool plan) {
  const std::string &up = texts.up, &stats = texts.stats;
  QUARRY_ASSIGN(options.memory, ParseSize(texts.memory, "--memory"));
  QUARRY_ASSIGN(const uint64_t voxel, ParseSize(texts.voxel_size, "--voxel-size"));
  if (!texts.unpack_limit.empty()) {
    QUARRY_ASSIGN(options.unpack_limit, ParseSize(texts.unpack_limit, "--unpack-limit"));
    if (options.unpack_limit == 0) return BadUsage("--unpack-limit must be positive");
  }
  if (options.memory < kLeastMemory) return BadUsage("--memory must be at least 64M");
  constexpr uint64_t kWindowsPerMemory = 8;  // the rest is for vertices that wait for faces
  LimitZstdWindow(options.memory / kWindowsPerMemory);
  if (voxel < kLeastVoxel || voxel > kLargestVoxel)
    return BadUsage("--voxel-size must lie between 4K and 4M");
  if (!(options.scale > 0) || options.scale > 1e12) return BadUsage("--scale must be a positive number");
  options.voxel_size = static_cast<uint32_t>(voxel);
  QUARRY_TRY(CheckImages(options, texts));
  options.up_axis = up == "y" ? 1 : up == "z" ? 2 : StatedUpAxis(options.models);
  QUARRY_TRY(ParseDeflection(texts.deflection, options));
  if (options.up_axis == 0 && !IsEnvironment(options))
    options.up_habit = UpHabitOf(options.models, options.unpack_limit);
  for (const std::string& place : texts.places) QUARRY_TRY(ParsePlacement(place, options));
  QUARRY_TRY(CheckOutputs(texts, options));
  if (plan && IsEnvironment(options)) return BadUsage("--plan has no effect on an image; leave it out");
  if (plan) return PrintPlan(options, stats);
  if (!IsEnvironment(options) && options.resume == PreprocessOptions::Resume::kNo && RoomIsTight(options)) {
    if (!options.quiet) Log("reading the model first, to check that the disk has room (see --plan)");
    QUARRY_ASSIGN(const PreprocessPlan needed, MakePlan(options));
    QUARRY_TRY(CheckRoomFor(options, needed));
  }
  QUARRY_ASSIGN(const PreprocessStatistics statistics, Preprocess(options));
  if (!options.quiet) PrintSummary(options, statistics);
  if (!stats.empty()) QUARRY_TRY(WriteFileAtomically(stats, AsBytes(StatisticsJson(options, statistics))));
  return {};
}

int Main(int argc, char** argv) {
  KeepHeapSmall(4 << 20);  // voxels are built again and again in buffers below this size
  PreprocessOptions options;
  options.threads = UsableProcessors();
  Texts texts;
  bool plan = false, resume = false, resume_if_fit = false;
  CLI::App app{
      "Cuts triangle models (PLY, OBJ, STL, OFF, NFF, AFF, glTF, 3MF; STEP and IGES by Open CASCADE; others "
      "by Assimp) into a scene store, "
      "out "
      "of core; an image of a sky (HDR, EXR) into the store of an environment.",
      "quarry-preprocess"};
  app.footer(
      "Examples:\n  quarry-preprocess plant.ply -o plant.quarry\n"
      "  quarry-preprocess hull.stl deck.obj -o ship.quarry --memory 512M --stats ship.json\n"
      "  quarry-preprocess hall.obj robot.ply -o cell.quarry --place robot.ply=2.5,0,0.1,90\n"
      "  quarry-preprocess city.obj.zst --plan\n"
      "  quarry-preprocess city.obj.zst -o city.quarry --resume\n"
      "  quarry-preprocess sunset.hdr -o sunset.quarry\n"
      "  curl -s https://models.example/scan.ply.gz | quarry-preprocess - -o scan.quarry");
  app.set_version_flag(
      "--version", [] { return VersionText("quarry-preprocess"); },
      "Print version, build and libraries, and exit");
  app.add_option("models", options.models,
                 "Model files, plain or packed by gzip or zstd; several make one scene; - is standard input")
      ->required();
  app.add_option("-o,--output", options.output, "The store to write; not needed with --plan");
  app.add_flag("--force", texts.force,
               "Replace the output though it holds something else; never a model that is read");
  app.add_option("--memory", texts.memory,
                 "Limit of resident memory, e.g. 512M; of Assimp's process too, which loads models whole")
      ->envname("QUARRY_MEMORY")
      ->capture_default_str();
  app.add_option("--threads", options.threads, "Builder threads")
      ->envname("QUARRY_THREADS")
      ->check(WholeNumber(1, 1024))
      ->capture_default_str();
  app.add_option("--tmp", options.tmp_folder, "Folder for spill files (default: the output's)")
      ->envname("QUARRY_TMP");
  app.add_option("--voxel-size", texts.voxel_size, "Largest size of a decoded voxel's hot part")
      ->capture_default_str();
  app.add_option("--up-axis,--up", texts.up,
                 "The models' up axis (default: y for glTF and Assimp's formats, z for 3MF, else guessed)")
      ->check(CLI::IsMember({"y", "z"}));
  app.add_option("--crease", options.crease,
                 "Largest angle in degrees at which triangles without normals are smoothed; 0: facets. "
                 "Smoothing groups of OBJ override it")
      ->check(RealNumber(0, 180))
      ->capture_default_str();
  app.add_option(
      "--deflection", texts.deflection,
      "For STEP and IGES: LINEAR[,ANGLE], largest distance of triangles from surfaces, in the file's unit, "
      "and largest angle between neighbours, in degrees (default: 1/2000 of the model's diagonal, 12)");
  app.add_option("--scale", options.scale, "Factor on all coordinates")
      ->check(RealNumber(1e-12, 1e12))
      ->capture_default_str();
  app.add_option(
      "--place", texts.places,
      "Place one model by MODEL=x,y,z[,turn[,scale]]: scaled, turned by degrees about the up axis, moved");
  app.add_option("--stats", texts.stats, "Write statistics as JSON to this file");
  app.add_flag("!--no-textures", options.textures, "Leave out the images that materials name");
  app.add_option("--checkpoint", options.checkpoint_seconds,
                 "About how many seconds of building --resume repeats after a kill")
      ->check(RealNumber(0, 86400))
      ->capture_default_str();
  app.add_option(
      "--unpack-limit", texts.unpack_limit,
      "Largest unpacked size of a packed model (default: 100 times its packed size, at least 256M)");
  app.add_flag("--resume", resume, "Continue an earlier run of the same command from its kept files");
  app.add_flag("--resume-if-fit", resume_if_fit)->group("");  // quarry render's
  app.add_flag(
      "--plan", plan,
      "Print the counts of triangles and vertices, the disk space and memory that a run takes, and about "
      "its time; make nothing");
  app.add_flag("--quiet", options.quiet, "Print errors only");
  constexpr NoEffect kNoEffect[] = {{"--resume", "--plan"}};
  RefuseWithoutEffect(app, kNoEffect);
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  if (options.output.empty() && !plan) {
    Log(
        fmt::format("quarry-preprocess: -o must name the store to write, e.g. -o {}.quarry; see "
                    "quarry-preprocess --help",
                    std::filesystem::path(options.models[0]).stem().string()));
    return 2;
  }
  if (resume) options.resume = PreprocessOptions::Resume::kYes;
  if (resume_if_fit) {
    options.resume = PreprocessOptions::Resume::kIfFit;
    options.goes_on = "the same command continues";
  }
  return ExitStatus(Run(options, texts, plan));
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry-preprocess", "nothing was written"}, argc, argv, quarry::Main);
}

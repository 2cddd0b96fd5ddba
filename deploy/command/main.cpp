#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <span>
#include <string>
#include <system_error>
#include <vector>

#include "common/base/cleanup.h"
#include "common/base/log.h"
#include "common/command_line/command_line.h"
#include "common/command_line/remote_options.h"
#include "common/command_line/security_options.h"
#include "common/kdtree/instruction_sets.h"
#include "common/program/installed_program.h"
#include "common/program/run_program.h"
#include "common/program/version_text.h"
#include "deploy/command/cache_command.h"
#include "deploy/command/cluster.h"
#include "deploy/command/info_command.h"
#include "deploy/command/model_cache.h"
#include "deploy/command/parts_command.h"
#include "deploy/command/query.h"
#include "deploy/command/rays/rays_command.h"
#include "deploy/command/render_command.h"
#include "deploy/command/slurm/slurm_command.h"
#include "deploy/command/view_command.h"

namespace quarry {
namespace {

constexpr const char* kNoBenches =
    "no benchmark is installed: the package quarry-bench has them; a build has them with the tests "
    "(cmake -DBUILD_TESTING=ON)";

/// The names of the quarry-bench-* programs that are installed or built here, without that prefix.
std::vector<std::string> Benches() {
  constexpr std::string_view kPrefix = "quarry-bench-";
  std::vector<std::string> names;
  std::error_code error;
  for (const auto& folder : ProgramFolders())
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
      if (const std::string name = entry.path().filename().string(); name.starts_with(kPrefix))
        names.push_back(name.substr(kPrefix.size()));
  std::ranges::sort(names);
  names.erase(std::unique(names.begin(), names.end()), names.end());
  return names;
}

/// Commands that start other programs.
struct ProgramCommand {
  std::string_view command;
  const char* program;
  const char* help;
};
constexpr ProgramCommand kProgramCommands[] = {
    {"preprocess", "quarry-preprocess", "Cut a model into a store (the program quarry-preprocess)"},
    {"master", "quarry-master", "Serve a scene to workers (the program quarry-master)"},
    {"worker", "quarry-worker", "Render for a master (the program quarry-worker)"},
    {"scene", "quarry-scene", "Write a generated model (the program quarry-scene)"}};

/// Becomes the program of `quarry COMMAND ...`. Returns only if that program cannot be started: the exit
/// status.
int BecomeProgram(const ProgramCommand& command, char** argv) {
  const std::string path = SiblingProgram(command.program);
  ::execv(path.c_str(), argv + 1);
  return ExitStatus(Fail(fmt::format("cannot run {}: {}", path, ErrnoText(errno))));
}

/// Runs `quarry bench NAME ...` as the program quarry-bench-NAME beside this program.
int RunBench(int argc, char** argv) {
  const std::string what = argc > 2 ? argv[2] : "--help";
  const std::vector<std::string> benches = Benches();
  if (what == "--help" || what == "-h") {
    Print(fmt::format(
        "Runs a benchmark program.\nUsage: quarry bench WHAT [ARGUMENTS]\n\n"
        "WHAT is one of: {}\n\nEach has its own help.\n\nExample:\n  quarry bench import plant.ply\n",
        benches.empty() ? kNoBenches : fmt::format("{}", fmt::join(benches, ", "))));
    return argc > 2 ? 0 : 2;
  }
  if (benches.empty()) {
    Log(fmt::format("quarry bench: {}", kNoBenches));
    return 1;
  }
  if (std::ranges::find(benches, what) != benches.end())
    ::execv(FindProgram("quarry-bench-" + what).c_str(), argv + 2);
  const std::string nearest = Nearest(what, benches);
  Log(fmt::format(
      "quarry bench: '{}' is not known{}", what,
      nearest.empty() ? "; see quarry bench --help" : fmt::format("; did you mean {}?", nearest)));
  return 2;
}

Status ShowStatus(const std::string& master, const SecurityOptions& options, bool json) {
  QUARRY_ASSIGN(const Endpoint endpoint, ParseEndpoint(master, "--master"));
  QUARRY_ASSIGN(const Security security, Security::ForClient(WithEnvironment(options)));
  return PrintStatus(endpoint, security, json);
}

Status PrintInfoOf(const std::string& scene, bool json, bool parts, const std::string& find, bool textures,
                   const RemoteArguments& remote) {
  QUARRY_ASSIGN(const HttpOptions http, ReadRemoteArguments(remote));
  if (parts) return PrintParts(scene, find, json, http);
  return textures ? PrintTextures(scene, json, http) : PrintInfo(scene, json, http);
}

Status VerifyOne(const std::string& scene, bool quiet, const RemoteArguments& remote) {
  QUARRY_ASSIGN(const HttpOptions http, ReadRemoteArguments(remote));
  return Verify(scene, quiet, http);
}

int Main(int argc, char** argv) {
  if (argc > 1 && std::string(argv[1]) == "bench") return RunBench(argc, argv);
  for (const ProgramCommand& command : kProgramCommands)
    if (argc > 1 && argv[1] == command.command) return BecomeProgram(command, argv);
  CLI::App app{"Quarry: ray tracing of triangle models larger than memory, on the machines at hand.",
               "quarry"};
  app.footer(
      "Examples:\n  quarry scene plant --triangles 1000000 -o plant.ply\n"
      "  quarry preprocess plant.ply -o plant.quarry\n"
      "  quarry render plant.ply -o plant.png --mode whitted --workers 3\n"
      "  quarry render plant.quarry -o walk.png --camera-path plant.path.json --frames 0-59\n"
      "  quarry view plant.quarry --open\n"
      "  quarry info plant.quarry --json\n  quarry info plant.quarry --parts --find valve\n  quarry rays "
      "plant.quarry -o hits.npy < rays.npy\n  quarry verify "
      "s3://models/plant.quarry\n  quarry cache list\n"
      "  quarry status --master 10.0.0.1:9000\n"
      "  quarry cluster --slurm -N 4 plant.quarry -- -o walk.png --camera-path walk.json\n"
      "  quarry bench import plant.ply");
  app.set_version_flag(
      "--version", [] { return VersionText("quarry", InstructionSets()); },
      "Print version, build, instruction set and libraries, and exit");
  app.require_subcommand(1);
  RenderArguments render;
  AddRenderOptions(*app.add_subcommand("render", "Render a picture, or a path of them"), render);
  ViewArguments view;
  AddViewCommandOptions(*app.add_subcommand("view", "Walk through a scene, live, in a browser"), view);
  std::string scene, find;
  bool json = false, parts = false, textures = false, quiet = false;
  auto* info = app.add_subcommand("info", "Describe the contents of a store");
  info->add_option("scene", scene, "The store: a file, or https://... or s3://BUCKET/KEY")->required();
  RemoteArguments remote;
  AddRemoteOptions(*info, remote);
  info->add_flag("--json", json, "As JSON");
  auto* const of_parts = info->add_flag(
      "--parts", parts, "The parts: triangles, surface, size, path; and the names of materials");
  info->add_option("--find", find, "Only parts whose names contain TEXT, or with a / in it their paths")
      ->type_name("TEXT")
      ->needs(of_parts);
  info->add_flag("--textures", textures, "The textures: shapes, bytes, and the materials that use them")
      ->excludes(of_parts);
  RaysArguments rays;
  auto* const rays_command = app.add_subcommand("rays", "Answer rays of an .npy file: hits, shade, counts");
  AddRaysOptions(*rays_command, rays);
  auto* verify = app.add_subcommand("verify", "Read and check every byte of a store");
  verify->add_option("scene", scene, "The store: a file, or https://... or s3://BUCKET/KEY")->required();
  AddRemoteOptions(*verify, remote);
  verify->add_flag("--quiet", quiet, "Print errors only");
  std::string master;
  SecurityOptions security;
  auto* cluster = app.add_subcommand("status", "Print a cluster's workers, jobs and rates");
  cluster->add_option("--master", master, "The master's HOST:PORT")->envname("QUARRY_MASTER")->required();
  cluster->add_flag("--json", json, "As JSON");
  AddSecurityOptions(*cluster, security);
  CacheArguments cache;
  auto* cache_command = app.add_subcommand("cache", "List, limit or remove the kept stores of models");
  AddCacheCommands(*cache_command, cache);
  ClusterArguments cluster_arguments;
  AddClusterCommandOptions(
      *app.add_subcommand("cluster", "Start a cluster on machines that Slurm gives, or end it"),
      cluster_arguments);
  for (const ProgramCommand& command : kProgramCommands)
    app.add_subcommand(std::string(command.command), command.help);
  app.add_subcommand("bench", "Run a benchmark program (package quarry-bench)");
  if (const auto ended = ParseCommandLine(app, argc, argv)) return *ended;
  render.command_line = fmt::format("{}", fmt::join(std::span(argv, static_cast<size_t>(argc)), " "));
  return ExitStatus(app.got_subcommand("render")    ? Render(render)
                    : app.got_subcommand("view")    ? ShowLive(view)
                    : app.got_subcommand("info")    ? PrintInfoOf(scene, json, parts, find, textures, remote)
                    : app.got_subcommand("rays")    ? RunRays(rays)
                    : app.got_subcommand("status")  ? ShowStatus(master, security, json)
                    : app.got_subcommand("cluster") ? RunClusterCommand(cluster_arguments)
                    : app.got_subcommand("cache")   ? RunCacheCommand(*cache_command, cache)
                                                    : VerifyOne(scene, quiet, remote));
}

}  // namespace
}  // namespace quarry

int main(int argc, char** argv) {
  return quarry::RunProgram({"quarry", quarry::kKeptOnSignal}, argc, argv, quarry::Main);
}

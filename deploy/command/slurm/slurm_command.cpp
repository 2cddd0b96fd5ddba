#include "deploy/command/slurm/slurm_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <fstream>
#include <optional>

#include "common/base/bytes.h"
#include "common/base/log.h"
#include "common/base/number.h"
#include "common/base/size.h"
#include "common/command_line/command_line.h"
#include "common/net/connection.h"
#include "common/net/security.h"
#include "common/remote/open_store.h"
#include "deploy/command/cluster.h"
#include "deploy/command/render_command.h"
#include "deploy/command/slurm/slurm_job.h"
#include "deploy/command/slurm/slurm_script.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// The arguments of `quarry render` that a job makes useless: they are the cluster's.
constexpr const char* kClusterOptions[] = {"--master",      "--workers",  "--threads", "--cache",
                                           "--secret-file", "--tls-cert", "--tls-key", "--tls-ca"};

/// Checks the arguments of a job's rendering, as `quarry render` does. Returns: the frames' first and last
/// number.
Result<std::pair<uint32_t, uint32_t>> CheckRendering(const ClusterArguments& a) {
  RenderArguments render;
  CLI::App app{"Render a picture, or a path of them", "quarry render"};
  AddRenderOptions(app, render);
  std::vector<std::string> line{"quarry render", a.scene};
  line.insert(line.end(), a.render.begin(), a.render.end());
  std::vector<char*> argv;
  for (std::string& word : line) argv.push_back(word.data());
  if (ParseCommandLine(app, static_cast<int>(argv.size()), argv.data())) return BadUsage("");
  for (const char* option : kClusterOptions)
    if (WasTyped(app, option))
      return BadUsage(
          fmt::format("{} has no effect on a job, which has a cluster of its own; leave it out", option));
  if (a.tasks > 0 && render.camera_path.empty())
    return BadUsage("--array divides the frames of a --camera-path, and none is given");
  QUARRY_ASSIGN(const RenderJob job, CheckedJob(render));
  if (job.view.environment.is_named())
    return BadUsage("--environment is not known to jobs yet; start quarry-master --environment by hand");
  if (a.tasks > job.cameras.size())
    return BadUsage(fmt::format("--array {}: there are {} frames to divide", a.tasks, job.cameras.size()));
  return std::pair(job.first_frame, job.first_frame + static_cast<uint32_t>(job.cameras.size()) - 1);
}

/// The arguments without --frames, which the tasks of an array have of their own.
std::vector<std::string> WithoutFrames(const std::vector<std::string>& arguments) {
  std::vector<std::string> rest;
  for (size_t i = 0; i < arguments.size(); ++i)
    if (arguments[i] == "--frames")
      ++i;
    else if (!arguments[i].starts_with("--frames="))
      rest.push_back(arguments[i]);
  return rest;
}

/// The option of quarry cluster's own that `option` gives to sbatch, perhaps abbreviated or behind other
/// letters; empty: none.
std::string OwnOptionIn(std::string_view option) {
  constexpr std::string_view kOwn[] = {"--job-name", "--output", "--chdir", "--array", "--wrap"};
  constexpr std::string_view kOwnLetters = "JoDa";
  constexpr std::string_view kFlags = "hHkOQsuvVW";  // letters of sbatch that take no value
  if (option.starts_with("--")) {
    const std::string_view name = option.substr(0, option.find('='));
    for (const std::string_view own : kOwn)
      if (name.size() > 2 && own.starts_with(name)) return std::string(own);
    return {};
  }
  for (size_t i = 1; i < option.size() && option.front() == '-'; ++i) {
    if (kOwnLetters.find(option[i]) != std::string_view::npos) return fmt::format("-{}", option[i]);
    if (kFlags.find(option[i]) == std::string_view::npos) break;
  }
  return {};
}

Status CheckCluster(const ClusterArguments& a) {
  if (!a.cache.empty()) {
    QUARRY_ASSIGN([[maybe_unused]] const uint64_t bytes, ParseSize(a.cache, "--cache"));
  }
  if (!a.http.empty()) {
    QUARRY_ASSIGN([[maybe_unused]] const Endpoint endpoint, ParseEndpoint(a.http, "--http"));
    if (!a.render.empty())
      return BadUsage("--http has no effect on a job that renders and ends; leave it out");
  }
  if (!a.secret_file.empty()) {
    QUARRY_ASSIGN([[maybe_unused]] const Bytes secret, ReadSecret(a.secret_file));
  }
  for (const std::string& option : a.sbatch)
    if (const std::string own = OwnOptionIn(option); !own.empty())
      return BadUsage(fmt::format("--sbatch={}: quarry cluster needs its own {}", option, own));
  if (a.tasks > 0 && a.render.empty())
    return BadUsage("--array needs the arguments of quarry render, after --");
  return {};
}

/// The options of sbatch, without the script.
std::vector<std::string> SbatchOptions(const ClusterArguments& a) {
  std::vector<std::string> options{fmt::format("--nodes={}", a.nodes), "--export=ALL"};
  // A worker uses all that its node gives.
  options.push_back(a.threads > 0 ? fmt::format("--cpus-per-task={}", a.threads) : "--exclusive");
  if (!a.time.empty()) options.push_back("--time=" + a.time);
  if (!a.partition.empty()) options.push_back("--partition=" + a.partition);
  if (a.tasks > 0) options.push_back(fmt::format("--array=0-{}", a.tasks - 1));
  options.push_back(a.tasks > 0 ? "--output=quarry-%A_%a.log" : "--output=quarry-%j.log");
  options.insert(options.end(), a.sbatch.begin(), a.sbatch.end());
  return options;
}

/// The variables that the script reads from its environment, with their values.
std::vector<std::pair<std::string, std::string>> ScriptEnvironment(const ClusterArguments& a,
                                                                   std::pair<uint32_t, uint32_t> frames) {
  std::vector<std::pair<std::string, std::string>> out{
      {"QUARRY_BIN", fs::path(SiblingProgram("quarry")).parent_path().string()}};
  if (!a.cache.empty()) out.emplace_back("QUARRY_CACHE", a.cache);
  if (a.threads > 0) out.emplace_back("QUARRY_THREADS", std::to_string(a.threads));
  if (!a.http.empty()) out.emplace_back("QUARRY_HTTP", a.http);
  if (!a.secret_file.empty()) out.emplace_back("QUARRY_SECRET_FILE", fs::absolute(a.secret_file).string());
  if (a.tasks > 0) out.emplace_back("QUARRY_FRAMES", fmt::format("{} {}", frames.first, frames.second));
  return out;
}

std::string Quoted(const std::string& word) {
  if (!word.empty() && word.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                              "-_=./:,%@+") == std::string::npos)
    return word;
  std::string out = "'";
  for (const char c : word) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

void PrintRendering(const ClusterArguments& a, const SlurmJob& job) {
  Print(fmt::format("job {} {} on {} node{}{}; log: {}\nend it: quarry cluster --stop {}\n", job.id,
                    a.no_wait ? "waits for Slurm, to run" : "renders", a.nodes, a.nodes == 1 ? "" : "s",
                    job.is_array ? fmt::format(", in {} tasks", a.tasks) : "",
                    job.is_array ? fmt::format("quarry-{}_*.log", job.id) : job.log, job.id));
}

/// The one line of a file in the job's folder.
std::string JobLine(const SlurmJob& job, const char* file) {
  std::string line;
  std::getline(std::ifstream(fmt::format("quarry-{}/{}", job.id, file)), line);
  return line;
}

/// The live view's URL is a secret, which the job's folder has.
Status PrintCluster(const ClusterArguments& a, const SlurmJob& job, const Endpoint& master) {
  const std::string secret = a.secret_file.empty() ? fmt::format("quarry-{}/secret", job.id) : a.secret_file;
  Print(fmt::format(
      "job {} runs until: quarry cluster --stop {}\nrender: quarry render -o picture.png --master {} "
      "--secret-file {}\n",
      job.id, job.id, TextOf(master), Quoted(secret)));
  if (a.http.empty()) return {};
  QUARRY_ASSIGN(const Endpoint view, ParseEndpoint(JobLine(job, "http"), "the job's live view"));
  Print(fmt::format("live view: ssh -L {}:{}:{} {}, then open {}\n", view.port, view.host, view.port,
                    master.host, JobLine(job, "url")));
  return {};
}

/// The script, and the command that submits it.
void PrintScript(const SlurmSubmission& submission) {
  PrintRaw("# ");
  for (const auto& [name, value] : submission.environment)
    PrintRaw(fmt::format("{}={} ", name, Quoted(value)));
  PrintRaw("sbatch");
  for (const std::string& option : submission.options) PrintRaw(fmt::format(" {}", Quoted(option)));
  PrintRaw(" quarry.sbatch");
  for (const std::string& word : submission.arguments) PrintRaw(fmt::format(" {}", Quoted(word)));
  PrintRaw(fmt::format("\n{}", kSlurmScript));
}

Status Start(const ClusterArguments& a) {
  QUARRY_TRY(CheckCluster(a));
  std::pair<uint32_t, uint32_t> frames{0, 0};
  if (a.render.empty()) {
    QUARRY_TRY(OpenStore(a.scene, {}).map([](auto&&) {}));
  } else {
    QUARRY_ASSIGN(frames, CheckRendering(a));
  }
  SlurmSubmission submission{SbatchOptions(a), ScriptEnvironment(a, frames), {a.scene}, a.tasks > 0};
  for (const std::string& word : a.tasks > 0 ? WithoutFrames(a.render) : a.render)
    submission.arguments.push_back(word);
  if (a.print) {
    PrintScript(submission);
    return {};
  }
  QUARRY_ASSIGN(const SlurmJob job, SubmitJob(submission));
  if (a.no_wait || !a.render.empty()) {
    if (!a.no_wait) QUARRY_TRY(AwaitStart(job).map([](auto&&) {}));
    PrintRendering(a, job);
    return {};
  }
  QUARRY_ASSIGN(const std::optional<Endpoint> master, AwaitStart(job));
  if (master) return PrintCluster(a, job, *master);
  PrintRendering(a, job);
  return {};
}

}  // namespace

void AddClusterCommandOptions(CLI::App& command, ClusterArguments& a) {
  command.footer(
      "Examples:\n  quarry cluster --slurm -N 4 plant.quarry -- -o walk.png --camera-path walk.json\n"
      "  quarry cluster --slurm -N 8 --time 2:00:00 --http 127.0.0.1:8080 plant.quarry\n"
      "  quarry cluster --slurm -N 1 --array 16 plant.quarry -- -o walk.png --camera-path walk.json\n"
      "  quarry cluster --stop 1234");
  auto* const slurm = command.add_flag("--slurm", a.slurm,
                                       "As a job of Slurm: the master on its first node, a worker on each");
  command.add_option("-N,--nodes", a.nodes, "Nodes")
      ->check(WholeNumber(1, 65536))
      ->capture_default_str()
      ->needs(slurm);
  command.add_option("--time", a.time, "The job's time limit, as sbatch has it")->needs(slurm);
  command.add_option("--partition", a.partition, "The partition of Slurm")->needs(slurm);
  command.add_option("--array", a.tasks, "Divide the frames among so many jobs of -N nodes each")
      ->check(WholeNumber(1, 10000))
      ->needs(slurm);
  command
      .add_option("--sbatch", a.sbatch,
                  "A further option of sbatch, such as --sbatch=--account=x; several may be given")
      ->allow_extra_args(false)
      ->needs(slurm);
  command.add_option("--threads", a.threads, "Compute threads of a worker (default: by Slurm's allocation)")
      ->check(WholeNumber(1, 1024))
      ->needs(slurm);
  command.add_option("--cache", a.cache, "Cache of a worker (default: by Slurm's allocation)")->needs(slurm);
  command
      .add_option("--http", a.http, "HOST:PORT of the live view on the first node, for a cluster that stays")
      ->needs(slurm);
  command.add_option("--secret-file", a.secret_file, "The cluster's secret (default: one of its own)")
      ->needs(slurm);
  command
      .add_flag("--print", a.print,
                "Print the job's script and the command that submits it, and submit nothing")
      ->needs(slurm);
  command.add_flag("--no-wait", a.no_wait, "Return once the job is submitted, not when it runs")
      ->needs(slurm);
  command.add_option("--stop", a.stop, "End the job with this number")->excludes(slurm);
  command.add_option("scene", a.scene, "The scene store, on a disk that the nodes share");
  command.add_option("render", a.render,
                     "After --: arguments of `quarry render`; without them the cluster stays");
}

Status RunClusterCommand(const ClusterArguments& arguments) {
  if (!arguments.stop.empty()) return StopJob(arguments.stop);
  if (!arguments.slurm) return BadUsage("say where: --slurm; or --stop JOB");
  if (arguments.scene.empty()) return BadUsage("name a scene store");
  return Start(arguments);
}

}  // namespace quarry

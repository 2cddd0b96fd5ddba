#include "deploy/slurm_command.h"

#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <thread>

#include "common/base/bytes.h"
#include "common/base/cleanup.h"
#include "common/base/file.h"
#include "common/base/number.h"
#include "common/base/size.h"
#include "common/command_line/command_line.h"
#include "common/engine/scene.h"
#include "common/net/connection.h"
#include "common/net/security.h"
#include "deploy/cluster.h"
#include "deploy/command_output.h"
#include "deploy/render_command.h"
#include "deploy/slurm_script.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// What the script's lines begin with.
constexpr std::string_view kMark = "quarry.sbatch: ";

/// A job of Slurm.
struct Job {
  std::string id, log;
  bool is_array = false;
};

/// The arguments of `quarry render` that a job makes useless: they are the cluster's.
constexpr const char* kOfTheCluster[] = {"--master",      "--workers",  "--threads", "--cache",
                                         "--secret-file", "--tls-cert", "--tls-key", "--tls-ca"};

/// Checks what a job is to render, as `quarry render` does. Returns: the frames' first and last number.
Result<std::pair<uint32_t, uint32_t>> CheckRendering(const ClusterArguments& a) {
  RenderArguments render;
  CLI::App app{"Render a picture, or a path of them", "quarry render"};
  AddRenderOptions(app, render);
  std::vector<std::string> line{"quarry render", a.scene};
  line.insert(line.end(), a.render.begin(), a.render.end());
  std::vector<char*> argv;
  for (std::string& word : line) argv.push_back(word.data());
  if (ParseCommandLine(app, static_cast<int>(argv.size()), argv.data())) return BadUsage("");
  for (const char* option : kOfTheCluster)
    if (WasTyped(app, option))
      return BadUsage(
          fmt::format("{} has no effect on a job, which has a cluster of its own; leave it out", option));
  if (a.tasks > 0 && render.camera_path.empty())
    return BadUsage("--array divides the frames of a --camera-path, and none is given");
  QUARRY_ASSIGN(const RenderJob job, CheckedJob(render));
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
  if (a.tasks > 0 && a.render.empty()) return BadUsage("--array needs what to render, after --");
  return {};
}

/// The options of sbatch, without the script.
std::vector<std::string> SbatchOptions(const ClusterArguments& a) {
  std::vector<std::string> options{fmt::format("--nodes={}", a.nodes)};
  if (!a.time.empty()) options.push_back("--time=" + a.time);
  if (!a.partition.empty()) options.push_back("--partition=" + a.partition);
  if (a.tasks > 0) options.push_back(fmt::format("--array=0-{}", a.tasks - 1));
  options.push_back(a.tasks > 0 ? "--output=quarry-%A_%a.log" : "--output=quarry-%j.log");
  options.insert(options.end(), a.sbatch.begin(), a.sbatch.end());
  return options;
}

/// What the script reads from its environment, as NAME=VALUE.
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

/// The script in a file of its own until this is destroyed.
class ScriptFile {
 public:
  static Result<std::unique_ptr<ScriptFile>> Write() {
    std::error_code error;
    std::string path = (fs::temp_directory_path(error) / "quarry-sbatch-XXXXXX").string();
    const SignalsHeld held;
    const int fd = error ? -1 : ::mkstemp(path.data());
    if (fd < 0) return Fail("cannot make a temporary file for the job's script");
    auto file = std::unique_ptr<ScriptFile>(new ScriptFile(std::move(path)));
    const std::string_view script = kSlurmScript;
    const bool written = ::write(fd, script.data(), script.size()) == static_cast<ssize_t>(script.size());
    ::close(fd);
    if (!written) return Fail(fmt::format("{}: cannot be written", file->path()));
    return file;
  }
  ~ScriptFile() {
    ::unlink(path_.c_str());
    Forget(registered_);
  }
  const std::string& path() const { return path_; }

 private:
  explicit ScriptFile(std::string path) : path_(std::move(path)), registered_(RemoveOnSignal(path_)) {}
  const std::string path_;
  const int registered_;
};

/// Slurm's own words without its prefixes.
std::string WordsOf(const CommandOutput& output) {
  std::string words = output.LastError();
  std::istringstream lines(output.err);
  for (std::string line; std::getline(lines, line);)
    if (line.find("error: ") != std::string::npos) {
      words = line;
      break;
    }
  const size_t at = words.rfind("error: ");
  return at == std::string::npos ? words : words.substr(at + 7);
}

Result<CommandOutput> Slurm(const std::string& name, const std::vector<std::string>& arguments) {
  auto output = OutputOf(name, arguments);
  if (!output) return Fail(output.error().message + ": is Slurm installed here?");
  return output;
}

Result<Job> Submit(const ClusterArguments& a, std::pair<uint32_t, uint32_t> frames) {
  QUARRY_ASSIGN(const auto script, ScriptFile::Write());
  for (const auto& [name, value] : ScriptEnvironment(a, frames)) ::setenv(name.c_str(), value.c_str(), 1);
  std::vector<std::string> words{"--parsable"};
  for (std::string& option : SbatchOptions(a)) words.push_back(std::move(option));
  words.push_back(script->path());
  words.push_back(a.scene);
  for (const std::string& word : a.tasks > 0 ? WithoutFrames(a.render) : a.render) words.push_back(word);
  QUARRY_ASSIGN(const CommandOutput output, Slurm("sbatch", words));
  const std::string id = output.out.substr(0, output.out.find_first_of(";\n"));
  if (output.status != 0 || id.empty()) return Fail("Slurm refuses the job: " + WordsOf(output));
  return Job{id, fmt::format("quarry-{}.log", id), a.tasks > 0};
}

/// Whether a job that waits for this reason would wait for ever.
bool IsHopeless(const std::string& reason) {
  for (const char* part :
       {"PartitionNodeLimit", "PartitionTimeLimit", "PartitionConfig", "BadConstraints", "NotAllowed",
        "PerJob", "PerNode", "Minutes", "InvalidAccount", "InvalidQOS", "JobHeldAdmin", "QOSMin"})
    if (reason.find(part) != std::string::npos) return true;
  return false;
}

/// The words after "quarry.sbatch: KIND" in the last such line of the log; none: there is no such line.
std::optional<std::string> Told(const std::string& log, const std::string& kind) {
  std::ifstream in(log);
  const std::string start = std::string(kMark) + kind;
  std::optional<std::string> words;
  for (std::string line; std::getline(in, line);)
    if (line.starts_with(start)) words = line.substr(std::min(line.size(), start.size() + 1));
  return words;
}

struct JobState {
  std::string state, reason;  ///< as squeue names them; empty: Slurm knows the job no more
};
Result<JobState> StateOf(const Job& job) {
  QUARRY_ASSIGN(const CommandOutput output,
                Slurm("squeue", {"--noheader", "--jobs=" + job.id, "--format=%T %r"}));
  std::istringstream line(output.out);
  JobState state;
  line >> state.state;
  std::getline(line >> std::ws, state.reason);
  return state;
}

void Cancel(const Job& job) { (void)OutputOf("scancel", {job.id}); }

/// Waits until the job runs. Errors: it fails at its start, or can never start.
Result<std::string> AwaitStart(const Job& job) {
  using namespace std::chrono_literals;
  TellOnSignal(fmt::format("job {} stays; quarry cluster --stop {} ends it", job.id, job.id));
  std::string told;
  for (;;) {
    if (const auto sentence = Told(job.log, "failed:"))
      return Fail(fmt::format("job {}: {}", job.id, *sentence));
    if (const auto address = Told(job.log, "ready")) return *address;
    if (Told(job.log, "done")) return std::string();
    QUARRY_ASSIGN(const JobState state, StateOf(job));
    if (IsHopeless(state.reason)) {
      Cancel(job);
      return Fail(fmt::format("Slurm would never start the job ({}); it is cancelled", state.reason));
    }
    if (state.state.empty() && !Told(job.log, "")) {
      std::this_thread::sleep_for(1s);  // the log may be late
      if (!Told(job.log, ""))
        return Fail(fmt::format("job {} has ended before it began; see {}", job.id, job.log));
    }
    const std::string now = state.state == "PENDING" ? fmt::format("waits ({})", state.reason) : "starts";
    if (now != told) fmt::print(stderr, "quarry: job {} {}\n", job.id, told = now);
    if (job.is_array && state.state != "PENDING") return std::string();
    std::this_thread::sleep_for(300ms);
  }
}

void PrintRendering(const ClusterArguments& a, const Job& job) {
  fmt::print("job {} renders on {} node{}{}; log: {}\nend it: quarry cluster --stop {}\n", job.id, a.nodes,
             a.nodes == 1 ? "" : "s", job.is_array ? fmt::format(", in {} tasks", a.tasks) : "",
             job.is_array ? fmt::format("quarry-{}_*.log", job.id) : job.log, job.id);
}

/// `address`: "HOST:PORT URL", the URL of the live view if there is one.
void PrintCluster(const ClusterArguments& a, const Job& job, const std::string& address) {
  const size_t blank = address.find(' ');
  const std::string master = address.substr(0, blank),
                    url = blank == std::string::npos ? "" : address.substr(blank + 1);
  const std::string secret = a.secret_file.empty() ? fmt::format("quarry-{}/secret", job.id) : a.secret_file;
  fmt::print(
      "job {} runs until: quarry cluster --stop {}\nrender: quarry render -o picture.png --master {} "
      "--secret-file {}\n",
      job.id, job.id, master, Quoted(secret));
  if (a.http.empty()) return;
  const std::string port = a.http.substr(a.http.rfind(':') + 1);
  fmt::print("live view: ssh -L {}:{} {}, then open {}\n", port, a.http, master.substr(0, master.rfind(':')),
             url);
}

Status Start(const ClusterArguments& a) {
  QUARRY_TRY(CheckCluster(a));
  std::pair<uint32_t, uint32_t> frames{0, 0};
  if (a.render.empty()) {
    QUARRY_TRY(Scene::Open(a.scene).map([](auto&&) {}));
  } else {
    QUARRY_ASSIGN(frames, CheckRendering(a));
  }
  if (a.print) {
    fmt::print("# ");
    for (const auto& [name, value] : ScriptEnvironment(a, frames)) fmt::print("{}={} ", name, Quoted(value));
    fmt::print("sbatch");
    for (const std::string& option : SbatchOptions(a)) fmt::print(" {}", Quoted(option));
    fmt::print(" quarry.sbatch {}", Quoted(a.scene));
    for (const std::string& word : a.tasks > 0 ? WithoutFrames(a.render) : a.render)
      fmt::print(" {}", Quoted(word));
    fmt::print("\n{}", kSlurmScript);
    return {};
  }
  QUARRY_ASSIGN(const Job job, Submit(a, frames));
  std::string address;
  if (!a.no_wait) {
    QUARRY_ASSIGN(address, AwaitStart(job));
  }
  if (!a.render.empty() || address.empty())
    PrintRendering(a, job);
  else
    PrintCluster(a, job, address);
  return {};
}

/// Ends a job and removes what it has left in its folder.
Status Stop(const std::string& id) {
  using namespace std::chrono_literals;
  if (id.find_first_not_of("0123456789") != std::string::npos)
    return BadUsage(fmt::format("--stop takes the number of a job, not '{}'", id));
  QUARRY_ASSIGN(const CommandOutput known, Slurm("squeue", {"--noheader", "--jobs=" + id, "--format=%j %Z"}));
  std::istringstream line(known.out);
  std::string name, folder;
  line >> name;
  std::getline(line >> std::ws, folder);
  if (known.status != 0 || name.empty()) return Fail(fmt::format("Slurm has no job {}", id));
  if (name != "quarry") return Fail(fmt::format("job {} is '{}', not a cluster of Quarry", id, name));
  QUARRY_ASSIGN(const CommandOutput cancelled, Slurm("scancel", {id}));
  if (cancelled.status != 0) return Fail(fmt::format("job {} cannot be ended: {}", id, WordsOf(cancelled)));
  for (;; std::this_thread::sleep_for(300ms)) {
    QUARRY_ASSIGN(const CommandOutput left, Slurm("squeue", {"--noheader", "--jobs=" + id, "--format=%T"}));
    if (left.out.empty()) break;
  }
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored)) {
    const std::string its = entry.path().filename().string(), mine = "quarry-" + id;
    if (entry.is_directory(ignored) && (its == mine || its.starts_with(mine + "_")))
      fs::remove_all(entry.path(), ignored);
  }
  fmt::print("job {} has ended\n", id);
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
  command
      .add_option("--threads", a.threads, "Compute threads of a worker (default: by what Slurm allocates)")
      ->check(WholeNumber(1, 1024))
      ->needs(slurm);
  command.add_option("--cache", a.cache, "Cache of a worker (default: by what Slurm allocates)")
      ->needs(slurm);
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
                     "After --: what to render, as `quarry render` has it; without, the cluster stays");
}

Status RunClusterCommand(const ClusterArguments& arguments) {
  if (!arguments.stop.empty()) return Stop(arguments.stop);
  if (!arguments.slurm) return BadUsage("say where: --slurm; or --stop JOB");
  if (arguments.scene.empty()) return BadUsage("name a scene store");
  return Start(arguments);
}

}  // namespace quarry

#include "deploy/command/slurm/slurm_job.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>
#include <thread>

#include "common/base/cleanup.h"
#include "common/base/log.h"
#include "deploy/command/command_output.h"
#include "deploy/command/slurm/slurm_script.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// The beginning of the lines that the script writes.
constexpr std::string_view kMark = "quarry.sbatch: ";

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

/// The answer of squeue about a job in `format`; empty: Slurm no longer knows the job. A controller that does
/// not answer is asked again for a while. Errors: it does not answer.
Result<std::string> AskOf(const std::string& id, const std::string& format) {
  constexpr int kMostAttempts = 20;
  CommandOutput output;
  for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
    QUARRY_ASSIGN(output, Slurm("squeue", {"--noheader", "--jobs=" + id, "--format=" + format}));
    if (output.status == 0) return output.out;
    if (output.err.find("Invalid job id") != std::string::npos) return std::string();
    std::this_thread::sleep_for(std::chrono::milliseconds(500));
  }
  return Fail(fmt::format("Slurm does not tell of job {}, which may go on: {}", id, WordsOf(output)));
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
std::optional<std::string> LineOf(const std::string& log, const std::string& kind) {
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
Result<JobState> StateOf(const SlurmJob& job) {
  QUARRY_ASSIGN(const std::string answer, AskOf(job.id, "%T %r"));
  std::istringstream line(answer);
  JobState state;
  line >> state.state;
  std::getline(line >> std::ws, state.reason);
  return state;
}

void Cancel(const SlurmJob& job) { (void)OutputOf("scancel", {job.id}); }

/// Whether the job, or a task of it, keeps its files in a folder while it lives. A folder that another user
/// made is not the job's.
bool IsKeptBy(const std::string& id, const fs::path& folder) {
  std::error_code ignored;
  const std::string name = folder.filename().string(), mine = "quarry-" + id;
  struct stat info {};
  const bool own = ::lstat(folder.c_str(), &info) == 0 && S_ISDIR(info.st_mode) && info.st_uid == ::geteuid();
  if (!name.starts_with(mine) || !own) return false;
  const std::string rest = name.substr(mine.size());
  const bool is_task =
      rest.size() > 1 && rest[0] == '_' && rest.find_first_not_of("0123456789", 1) == std::string::npos;
  return (rest.empty() || is_task) && fs::exists(folder / "master.out", ignored);
}

/// Removes the folders that a job has left in the folder in which it was submitted. Returns: whether there
/// was one.
bool RemoveKept(const std::string& id, const std::string& submitted_in) {
  std::error_code ignored;
  bool any = false;
  for (const auto& entry : fs::directory_iterator(submitted_in, ignored))
    if (IsKeptBy(id, entry.path())) any |= fs::remove_all(entry.path(), ignored) > 0;
  return any;
}

}  // namespace

Result<SlurmJob> SubmitJob(const SlurmSubmission& submission) {
  QUARRY_ASSIGN(const auto script, ScriptFile::Write());
  // Variables of a job that submits this one: they describe that job alone.
  for (const char* name : {"SLURM_ARRAY_JOB_ID", "SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT",
                           "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_MAX", "SLURM_RESTART_COUNT"})
    ::unsetenv(name);
  for (const auto& [name, value] : submission.environment) ::setenv(name.c_str(), value.c_str(), 1);
  std::vector<std::string> words{"--parsable"};
  words.insert(words.end(), submission.options.begin(), submission.options.end());
  words.push_back(script->path());
  words.insert(words.end(), submission.arguments.begin(), submission.arguments.end());
  QUARRY_ASSIGN(const CommandOutput output, Slurm("sbatch", words));
  const std::string id = output.out.substr(0, output.out.find_first_of(";\n"));
  if (output.status != 0 || id.empty()) return Fail("Slurm refuses the job: " + WordsOf(output));
  return SlurmJob{id, fmt::format("quarry-{}.log", id), submission.is_array};
}

Result<std::optional<Endpoint>> AwaitStart(const SlurmJob& job) {
  using namespace std::chrono_literals;
  PrintOnSignal(fmt::format("job {} stays; quarry cluster --stop {} ends it", job.id, job.id));
  std::string last_state;
  for (bool gone = false;;) {
    if (const auto sentence = LineOf(job.log, "failed:"))
      return Fail(fmt::format("job {}: {}", job.id, *sentence));
    if (const auto address = LineOf(job.log, "ready")) {
      QUARRY_ASSIGN(const Endpoint master, ParseEndpoint(*address, job.log));
      return master;
    }
    if (LineOf(job.log, "done")) return std::nullopt;
    QUARRY_ASSIGN(const JobState state, StateOf(job));
    if (IsHopeless(state.reason)) {
      Cancel(job);
      return Fail(fmt::format("Slurm would never start the job ({}); it is cancelled", state.reason));
    }
    if (state.state.empty()) {
      if (gone) return Fail(fmt::format("job {} has ended before it was ready; see {}", job.id, job.log));
      gone = true;
      std::this_thread::sleep_for(1s);  // the log may be late
      continue;
    }
    const std::string now = state.state == "PENDING" ? fmt::format("waits ({})", state.reason) : "starts";
    if (now != last_state) Log(fmt::format("quarry: job {} {}", job.id, last_state = now));
    if (job.is_array && state.state != "PENDING") return std::nullopt;
    std::this_thread::sleep_for(300ms);
  }
}

Status StopJob(const std::string& id) {
  constexpr auto kOften = std::chrono::milliseconds(300);
  constexpr int kMostRounds = 1000;
  const size_t digits = id.find_first_not_of("0123456789");
  if (digits == 0 ||
      (digits != std::string::npos && (id[digits] != '_' || id.size() == digits + 1 ||
                                       id.find_first_not_of("0123456789", digits + 1) != std::string::npos)))
    return BadUsage(fmt::format("--stop takes the number of a job, not '{}'", id));
  QUARRY_ASSIGN(const std::string known, AskOf(id, "%j %Z"));
  std::istringstream line(known);
  std::string name, folder;
  line >> name;
  std::getline(line >> std::ws, folder);
  if (name.empty()) {
    if (!RemoveKept(id, ".")) return Fail(fmt::format("Slurm has no job {}", id));
    Print(fmt::format("job {} had ended; its files here are removed\n", id));
    return {};
  }
  if (name != "quarry") return Fail(fmt::format("job {} is '{}', not a cluster of Quarry", id, name));
  QUARRY_ASSIGN(const CommandOutput cancelled, Slurm("scancel", {id}));
  if (cancelled.status != 0) return Fail(fmt::format("job {} cannot be ended: {}", id, WordsOf(cancelled)));
  for (int round = 0;; ++round, std::this_thread::sleep_for(kOften)) {
    QUARRY_ASSIGN(const std::string left, AskOf(id, "%T"));
    if (left.empty()) break;
    if (round == kMostRounds)
      return Fail(fmt::format("job {} is cancelled, and has not ended yet: it is {}", id,
                              left.substr(0, left.find('\n'))));
  }
  RemoveKept(id, folder);
  Print(fmt::format("job {} has ended\n", id));
  return {};
}

}  // namespace quarry

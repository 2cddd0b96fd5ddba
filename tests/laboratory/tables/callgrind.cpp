#include "tests/laboratory/tables/callgrind.h"

#include <cpuid.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "common/base/check.h"

namespace quarry::laboratory {

namespace {

namespace fs = std::filesystem;

constexpr const char* kNotInstalled =
    "valgrind is not installed: deploy/install --tests installs it, or apt-get install valgrind.";

/// A new folder, removed at the end.
struct TemporaryFolder {
  fs::path path;

  static Result<TemporaryFolder> Create() {
    std::error_code error;
    const fs::path base = fs::temp_directory_path(error);
    std::string name = (base / "quarry-callgrind-XXXXXX").string();
    if (error || !::mkdtemp(name.data()))
      return Fail(fmt::format("{}: cannot make a temporary folder: {}", name,
                              error ? error.message() : ErrnoText(errno)));
    TemporaryFolder folder;
    folder.path = name;
    return folder;
  }
  TemporaryFolder() = default;
  TemporaryFolder(TemporaryFolder&& other) noexcept { std::swap(path, other.path); }
  TemporaryFolder& operator=(TemporaryFolder&& other) noexcept {
    std::swap(path, other.path);
    return *this;
  }
  ~TemporaryFolder() {
    std::error_code ignored;
    if (!path.empty()) fs::remove_all(path, ignored);
  }
};

std::string Contents(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

/// The last line of a program's output that is not blank, after ": "; "." if there is none.
std::string LastWords(const fs::path& path) {
  std::istringstream lines(Contents(path));
  std::string last;
  for (std::string line; std::getline(lines, line);)
    if (line.find_first_not_of(" \t\r") != std::string::npos) last = line;
  return last.empty() ? "." : ": " + last;
}

/// Runs a program of the PATH with its output in a file. Returns: the status of waitpid().
Result<int> RunProgram(const std::vector<std::string>& command, const fs::path& output) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  ::posix_spawn_file_actions_addopen(&actions, STDERR_FILENO, output.c_str(), O_WRONLY | O_CREAT | O_TRUNC,
                                     0600);
  pid_t child = 0;
  const int failed = ::posix_spawnp(&child, arguments[0], &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  if (failed == ENOENT) return Fail(kNotInstalled);
  if (failed) return Fail(fmt::format("cannot start {}: {}", command[0], ErrnoText(failed)));
  int status = 0;
  while (::waitpid(child, &status, 0) < 0)
    if (errno != EINTR) return Fail(fmt::format("cannot wait for {}: {}", command[0], ErrnoText(errno)));
  return status;
}

}  // namespace

bool ValgrindInstalled() {
  const char* path = ::getenv("PATH");
  std::istringstream folders(path ? path : "");
  for (std::string folder; std::getline(folders, folder, ':');)
    if (::access((folder + "/valgrind").c_str(), X_OK) == 0) return true;
  return false;
}

std::string WhyNotCounted() {
  if (!ValgrindInstalled()) return "valgrind is not installed";
  constexpr unsigned kExtended = 0x80000001, kRdtscp = 1u << 27;  // of EDX
  unsigned a = 0, b = 0, c = 0, d = 0;
  return __get_cpuid(kExtended, &a, &b, &c, &d) != 0 && (d & kRdtscp) != 0
             ? ""
             : "under valgrind libhwy needs RDTSCP, which this processor lacks";
}

Result<FunctionCosts> CountInstructions(const std::vector<std::string>& command,
                                        std::span<const std::string> functions, bool at_request) {
  QUARRY_CHECK(!command.empty());
  QUARRY_ASSIGN(const TemporaryFolder folder, TemporaryFolder::Create());
  const fs::path profile = folder.path / "profile", errors = folder.path / "errors";
  // Without lines, costs of a function stand together.
  std::vector<std::string> arguments{"valgrind",         "-q",
                                     "--tool=callgrind", "--callgrind-out-file=" + profile.string(),
                                     "--dump-line=no",   "--demangle=yes"};
  if (at_request) arguments.emplace_back("--instr-atstart=no");
  arguments.insert(arguments.end(), command.begin(), command.end());
  QUARRY_ASSIGN(const int status, RunProgram(arguments, errors));
  if (WIFSIGNALED(status))
    return Fail(fmt::format("{} was ended by signal {} ({}) under valgrind{}", command[0], WTERMSIG(status),
                            ::strsignal(WTERMSIG(status)), LastWords(errors)));
  if (WEXITSTATUS(status) != 0)
    return Fail(fmt::format("{} failed with status {} under valgrind{}", command[0], WEXITSTATUS(status),
                            LastWords(errors)));
  if (!fs::exists(profile)) return Fail(fmt::format("valgrind wrote no profile of {}.", command[0]));
  return ReadCallgrindProfile(Contents(profile), "the profile of " + command[0], functions);
}

}  // namespace quarry::laboratory

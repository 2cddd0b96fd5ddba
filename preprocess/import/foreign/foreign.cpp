#include "preprocess/import/foreign/foreign.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <system_error>
#include <utility>

#include "common/base/cleanup.h"
#include "preprocess/import/files/model_files.h"
#include "preprocess/import/foreign/child_environment.h"

namespace quarry {
namespace {

constexpr size_t kMostComplaint = 2000;

/// Reads from a pipe until all of its writers have closed it.
std::string ReadAll(int fd) {
  std::string text;
  char buffer[512];
  for (;;) {
    const ssize_t n = ::read(fd, buffer, sizeof buffer);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    if (text.size() < kMostComplaint) text.append(buffer, static_cast<size_t>(n));
  }
  while (!text.empty() && (text.back() == '\n' || text.back() == '\r')) text.pop_back();
  return text.substr(text.rfind('\n') + 1);  // its last line; libraries may print before it
}

}  // namespace

void RemoveForeignImages(const std::string& prefix) {
  namespace fs = std::filesystem;
  const fs::path path(prefix + ".image-");
  std::error_code error;
  for (const auto& entry :
       fs::directory_iterator(path.parent_path().empty() ? "." : path.parent_path(), error))
    if (entry.path().filename().string().starts_with(path.filename().string()))
      fs::remove(entry.path(), error);
}

ForeignModel::ForeignModel(std::string prefix)
    : prefix_(std::move(prefix)), cleanups_{RemoveOnSignal(ply()), RemoveOnSignal(library())} {}

ForeignModel::ForeignModel(ForeignModel&& other) noexcept
    : prefix_(std::exchange(other.prefix_, {})),
      cleanups_{std::exchange(other.cleanups_[0], -1), std::exchange(other.cleanups_[1], -1)} {}

ForeignModel::~ForeignModel() {
  if (prefix_.empty()) return;
  ::unlink(ply().c_str());
  ::unlink(library().c_str());
  for (const int cleanup : cleanups_) Forget(cleanup);
}

Result<ForeignModel> ForeignModel::Convert(const std::string& model, const ForeignFormats& formats) {
  DisownModelFiles(formats.prefix);
  ForeignModel converted(formats.prefix);
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return Fail(fmt::format("{}: {}", model, ErrnoText(errno)));
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, ends[1], 2);
  const std::string ply = converted.ply(), memory = std::to_string(formats.memory);
  char* arguments[] = {const_cast<char*>(formats.program.c_str()), const_cast<char*>(model.c_str()),
                       const_cast<char*>(ply.c_str()), const_cast<char*>(memory.c_str()), nullptr};
  ChildEnvironment environment;
  pid_t child = -1;
  const int error =
      ::posix_spawn(&child, formats.program.c_str(), &actions, nullptr, arguments, environment.get());
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(ends[1]);
  const std::string complaint = error == 0 ? ReadAll(ends[0]) : "";
  ::close(ends[0]);
  if (error != 0) return Fail(fmt::format("{}: cannot be started: {}", formats.program, ErrnoText(error)));
  int status = 0;
  while (::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return converted;
  if (WIFEXITED(status) && WEXITSTATUS(status) == kNoLibrary)
    return Fail(
        fmt::format("{}: {}, which reads all formats but PLY, OBJ, STL, OFF, NFF, AFF, glTF and 3MF, lacks "
                    "shared libraries: install Assimp (Debian's package libassimp5)",
                    model, formats.program));
  if (WIFEXITED(status) && !complaint.empty()) return Fail(complaint);
  return Fail(fmt::format(
      "{}: Assimp, which reads all formats but PLY, OBJ, STL, OFF, NFF, AFF, glTF and 3MF, has crashed on it",
      model));
}

}  // namespace quarry

#include "preprocess/import/foreign/helper_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <utility>

#include "preprocess/import/foreign/child_environment.h"

namespace quarry {

Status HelperProcess::Start() {
  if (running()) return {};
  int in[2], out[2];
  if (::pipe2(in, O_CLOEXEC) != 0) return Fail(fmt::format("a pipe: {}", ErrnoText(errno)));
  if (::pipe2(out, O_CLOEXEC) != 0) {
    const int error = errno;
    ::close(in[0]);
    ::close(in[1]);
    return Fail(fmt::format("a pipe: {}", ErrnoText(error)));
  }
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_adddup2(&actions, in[0], 0);
  ::posix_spawn_file_actions_adddup2(&actions, out[1], 1);
  const std::string memory = std::to_string(memory_);
  char* arguments[] = {program_.data(), const_cast<char*>(memory.c_str()), nullptr};
  ChildEnvironment environment;
  const int error = ::posix_spawn(&child_, program_.c_str(), &actions, nullptr, arguments, environment.get());
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(in[0]);
  ::close(out[1]);
  to_ = in[1];
  from_ = out[0];
  // Fewer turns between the processes. Best effort: the system limits the size.
  ::fcntl(from_, F_SETPIPE_SZ, 1 << 20);
  if (error == 0) return {};
  child_ = -1;
  Stop();
  return Fail(fmt::format("{}: cannot be started: {}", program_, ErrnoText(error)));
}

void HelperProcess::Stop() {
  if (running()) ::kill(child_, SIGKILL);
  Wait();
}

int HelperProcess::Wait() {
  for (int* fd : {&to_, &from_})
    if (*fd >= 0) ::close(std::exchange(*fd, -1));
  int status = 0;
  if (!running()) return status;
  while (::waitpid(child_, &status, 0) < 0 && errno == EINTR) {
  }
  child_ = -1;
  return status;
}

}  // namespace quarry

#include "common/base/file_lock.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "common/base/cleanup.h"
#include "common/base/output_path.h"

namespace quarry {

Result<FileLock> FileLock::Take(const std::string& path, const std::string& holder) {
  QUARRY_ASSIGN(std::optional<FileLock> lock, TryTake(path));
  if (!lock) return Fail(fmt::format("{}: {} is writing it", path, holder));
  return std::move(*lock);
}

Result<std::optional<FileLock>> FileLock::TryTake(const std::string& path) {
  std::string name = BesidePath(path, ".lock");
  const SignalsHeld held;
  for (;;) {
    const int fd = ::open(name.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NONBLOCK | O_NOCTTY, 0644);
    if (fd < 0) return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
    if (::flock(fd, LOCK_EX | LOCK_NB) != 0) {
      const int error = errno;
      ::close(fd);
      if (error == EINTR) continue;
      if (error == EWOULDBLOCK) return std::nullopt;
      return Fail(fmt::format("{}: cannot lock: {}", name, ErrnoText(error)));
    }
    // Another process may have removed the file after our open() and before our flock().
    struct stat locked {
    }, named{};
    if (::fstat(fd, &locked) == 0 && ::stat(name.c_str(), &named) == 0 && locked.st_ino == named.st_ino) {
      if (S_ISREG(locked.st_mode) && locked.st_size == 0) return std::optional(FileLock(std::move(name), fd));
      ::close(fd);  // releases the lock; the file belongs to someone else
      return BadUsage(
          fmt::format("{}: exists and is not a lock file of Quarry, which needs this name; name another "
                      "output, or remove it first",
                      name));
    }
    ::close(fd);
  }
}

FileLock::FileLock(std::string name, int fd)
    : name_(std::move(name)), fd_(fd), cleanup_(RemoveOnSignal(name_)) {}

FileLock::~FileLock() {
  if (fd_ < 0) return;
  ::unlink(name_.c_str());
  Forget(cleanup_);
  ::close(fd_);
}

}  // namespace quarry

#include "common/base/descriptor.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>

namespace quarry {

OwnedDescriptor::~OwnedDescriptor() {
  if (fd_ >= 0) ::close(fd_);
}

bool ReadAll(int fd, std::span<std::byte> out) {
  for (size_t done = 0; done < out.size();) {
    const ssize_t n = ::read(fd, out.data() + done, out.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<size_t>(n);
  }
  return true;
}

bool WriteAll(int fd, std::span<const std::byte> bytes) {
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    done += static_cast<size_t>(n);
  }
  return true;
}

bool StrangerOwns(const struct stat& info) { return info.st_uid != ::geteuid() && info.st_uid != 0; }

std::string StrangerSentence(const std::string& path, const struct stat& info) {
  return fmt::format("{}: belongs to another user ({}) than this program's ({}); use a copy that you own",
                     path, info.st_uid, ::geteuid());
}

}  // namespace quarry

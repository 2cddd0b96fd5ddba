#pragma once

#include <sys/stat.h>

#include <cstddef>
#include <span>
#include <string>

namespace quarry {

/// A file descriptor that is closed at its end.
class OwnedDescriptor {
 public:
  explicit OwnedDescriptor(int fd) : fd_(fd) {}
  ~OwnedDescriptor();
  OwnedDescriptor(const OwnedDescriptor&) = delete;
  OwnedDescriptor& operator=(const OwnedDescriptor&) = delete;
  int get() const { return fd_; }
  explicit operator bool() const { return fd_ >= 0; }

 private:
  int fd_;
};

/// Reads until `out` is full. Returns: false at the end of the data and after an error. Thread-safe.
bool ReadAll(int fd, std::span<std::byte> out);
/// Writes all of `bytes`. Returns: false after an error. The caller handles SIGPIPE. Thread-safe.
bool WriteAll(int fd, std::span<const std::byte> bytes);

/// Whether a file belongs to another user than this process's or root. Such a user may change it at any time,
/// so a secret in it is not safe, whatever its mode.
bool StrangerOwns(const struct stat& info);
/// The sentence for a secret that another user owns.
std::string StrangerSentence(const std::string& path, const struct stat& info);

}  // namespace quarry

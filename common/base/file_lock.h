#pragma once

#include <optional>
#include <string>
#include <utility>

#include "common/base/status.h"

namespace quarry {

/// Keeps other processes from writing the same output: "PATH.lock", held while the object lives. A process
/// that dies lets go, however it dies; the file it leaves is taken over by the next. Advisory, on one machine
/// or a file system with locks. Movable.
class FileLock {
 public:
  /// Errors: another process holds it (named by `holder`, "another quarry-preprocess"); the folder cannot be
  /// written; (usage) a file of that name holds something.
  static Result<FileLock> Take(const std::string& path, const std::string& holder);
  /// The same; nothing where another process holds it.
  static Result<std::optional<FileLock>> TryTake(const std::string& path);
  FileLock(FileLock&& other) noexcept
      : name_(std::move(other.name_)),
        fd_(std::exchange(other.fd_, -1)),
        cleanup_(std::exchange(other.cleanup_, -1)) {}
  FileLock& operator=(FileLock&&) = delete;
  ~FileLock();

 private:
  FileLock(std::string name, int fd);
  std::string name_;
  int fd_;
  int cleanup_;  ///< see RemoveOnSignal
};

}  // namespace quarry

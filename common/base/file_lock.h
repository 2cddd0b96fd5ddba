#pragma once

#include <optional>
#include <string>
#include <utility>

#include "common/base/status.h"

namespace quarry {

/// An exclusive lock on an output: holds "PATH.lock" (BesidePath()) while the object lives. The system
/// releases the lock when the process dies in any way; the next process takes over the file left behind.
/// Advisory; works between processes of one machine, or on a file system with locks. Movable.
class FileLock {
 public:
  /// Takes the lock. `holder` names the other process in messages: "another quarry-preprocess".
  /// Errors: another process holds the lock; the folder cannot be written; (usage) "PATH.lock" exists and is
  /// not empty or not a regular file.
  static Result<FileLock> Take(const std::string& path, const std::string& holder);
  /// As Take(), but returns nothing when another process holds the lock.
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
  int cleanup_;  ///< handle of RemoveOnSignal()
};

}  // namespace quarry

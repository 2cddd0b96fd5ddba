#pragma once

#include <string>
#include <utility>

#include "common/base/status.h"

namespace quarry {

/// A file that may be made meanwhile, and goes with the object, or with the program if a signal ends it.
class TemporaryFile {
 public:
  explicit TemporaryFile(std::string path);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  int cleanup_;  ///< see RemoveOnSignal
};

/// A folder, made with the object, that goes with it and with all files in it, as a TemporaryFile does.
class TemporaryFolder {
 public:
  /// Errors: it cannot be made.
  static Result<TemporaryFolder> Make(std::string path);
  TemporaryFolder(TemporaryFolder&& other) noexcept
      : path_(std::exchange(other.path_, {})), cleanup_(std::exchange(other.cleanup_, -1)) {}
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;
  ~TemporaryFolder();
  const std::string& path() const { return path_; }

 private:
  TemporaryFolder(std::string path, int cleanup) : path_(std::move(path)), cleanup_(cleanup) {}
  std::string path_;
  int cleanup_;
};

}  // namespace quarry

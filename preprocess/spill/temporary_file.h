#pragma once

#include <string>
#include <utility>

#include "common/base/status.h"

namespace quarry {

/// A path whose file, once created, is deleted with the object, or by a signal that ends the program.
class TemporaryFile {
 public:
  explicit TemporaryFile(std::string path);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  int cleanup_;  ///< see RemoveOnSignal()
};

/// A folder that is created with the object and deleted with it, with all its files, also by a signal.
class TemporaryFolder {
 public:
  /// Errors: it cannot be created.
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

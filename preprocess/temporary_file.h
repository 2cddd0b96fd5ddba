#pragma once

#include <string>

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

}  // namespace quarry

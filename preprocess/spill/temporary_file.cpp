#include "preprocess/spill/temporary_file.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <utility>

#include "common/base/cleanup.h"

namespace quarry {

TemporaryFile::TemporaryFile(std::string path) : path_(std::move(path)), cleanup_(RemoveOnSignal(path_)) {}

TemporaryFile::~TemporaryFile() {
  ::unlink(path_.c_str());
  Forget(cleanup_);
}

Result<TemporaryFolder> TemporaryFolder::Make(std::string path) {
  const SignalsHeld held;
  if (::mkdir(path.c_str(), 0700) != 0)
    return Fail(fmt::format("{}: cannot make this folder: {}", path, ErrnoText(errno)));
  const int cleanup = RemoveFolderOnSignal(path);
  return TemporaryFolder(std::move(path), cleanup);
}

TemporaryFolder::~TemporaryFolder() {
  if (path_.empty()) return;
  std::error_code ignored;
  std::filesystem::remove_all(path_, ignored);
  Forget(cleanup_);
}

}  // namespace quarry

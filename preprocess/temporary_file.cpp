#include "preprocess/temporary_file.h"

#include <unistd.h>

#include <utility>

#include "common/base/cleanup.h"

namespace quarry {

TemporaryFile::TemporaryFile(std::string path) : path_(std::move(path)), cleanup_(RemoveOnSignal(path_)) {}

TemporaryFile::~TemporaryFile() {
  ::unlink(path_.c_str());
  Forget(cleanup_);
}

}  // namespace quarry

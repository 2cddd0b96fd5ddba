#include "preprocess/import/file_identity.h"

#include <fmt/format.h>
#include <sys/stat.h>

namespace quarry {

std::string FileIdentity(const std::string& path) {
  struct stat info {};
  if (path == "-" || ::stat(path.c_str(), &info) != 0) return path;
  return fmt::format("{} of {} bytes, changed at {}.{:09}", path, info.st_size, info.st_mtim.tv_sec,
                     info.st_mtim.tv_nsec);
}

}  // namespace quarry

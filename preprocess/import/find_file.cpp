#include "preprocess/import/find_file.h"

#include <algorithm>

namespace quarry {
namespace {

namespace fs = std::filesystem;

bool IsFile(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

}  // namespace

fs::path FindFile(const fs::path& folder, const std::string& name) {
  if (name.empty() || name.find('\0') != std::string::npos) return {};
  std::string slashed = name;
  std::ranges::replace(slashed, '\\', '/');
  for (const fs::path& candidate : {folder / name, folder / slashed, folder / fs::path(slashed).filename()})
    if (IsFile(candidate)) return candidate;
  return {};
}

}  // namespace quarry

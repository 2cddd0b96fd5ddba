#include "preprocess/import/find_file.h"

#include <algorithm>

#include "preprocess/import/file_identity.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

bool IsFile(const fs::path& path) {
  std::error_code ignored;
  return fs::is_regular_file(path, ignored);
}

std::string Slashed(std::string name) {
  std::ranges::replace(name, '\\', '/');
  return name;
}

}  // namespace

bool LeavesFolder(const fs::path& folder, const fs::path& file) {
  const fs::path inside =
      fs::path(Slashed(file.string())).lexically_normal().lexically_relative(folder.lexically_normal());
  return inside.empty() || *inside.begin() == "..";
}

fs::path FindFile(const fs::path& folder, const std::string& name) {
  if (name.empty() || name.find('\0') != std::string::npos) return {};
  const std::string slashed = Slashed(name);
  for (const fs::path& candidate : {folder / name, folder / slashed, folder / fs::path(slashed).filename()})
    if (NoteModelFile(candidate.string()); IsFile(candidate)) return candidate;
  return {};
}

}  // namespace quarry

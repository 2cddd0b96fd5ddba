#include "preprocess/import/files/find_file.h"

#include <algorithm>
#include <system_error>

#include "preprocess/import/files/model_files.h"
#include "preprocess/import/text/text_number.h"

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

/// Compares names without regard to case. Of several matches, the first by name.
fs::path FindWhateverCase(const fs::path& wanted) {
  const std::string name = wanted.filename().string();
  fs::path found;
  std::error_code error;
  for (const auto& entry :
       fs::directory_iterator(wanted.parent_path().empty() ? "." : wanted.parent_path(), error))
    if (EqualsIgnoringCase(entry.path().filename().string(), name) && IsFile(entry.path()) &&
        (found.empty() || entry.path() < found))
      found = entry.path();
  return found;
}

/// The ends of a path with slashes, the longest first: of "../a/b/c" are "a/b/c", "b/c" and "c".
std::vector<fs::path> EndsOf(const std::string& slashed) {
  constexpr size_t kMost = 8;
  std::vector<fs::path> ends;
  fs::path end;
  const fs::path path(slashed);
  for (auto part = path.end(); part != path.begin() && ends.size() < kMost;) {
    --part;
    if (*part == ".." || *part == "/" || part->empty()) break;
    end = end.empty() ? *part : *part / end;
    ends.push_back(end);
  }
  std::ranges::reverse(ends);
  return ends;
}

fs::path FindIn(const fs::path& folder, const std::string& name) {
  const std::string slashed = Slashed(name);
  std::vector<fs::path> candidates = {folder / name, folder / slashed};
  for (const fs::path& end : EndsOf(slashed)) candidates.push_back(folder / end);
  for (const fs::path& candidate : candidates)
    if (NoteModelFile(candidate.string()); IsFile(candidate)) return candidate;
  for (const fs::path& candidate : {folder / slashed, folder / fs::path(slashed).filename()}) {
    fs::path found = FindWhateverCase(candidate);
    if (found.empty()) continue;
    NoteModelFile(found.string());
    return found;
  }
  return {};
}

bool Leaves(const fs::path& folder, const fs::path& file) {
  const fs::path inside =
      fs::path(Slashed(file.string())).lexically_normal().lexically_relative(folder.lexically_normal());
  return inside.empty() || *inside.begin() == "..";
}

}  // namespace

std::vector<fs::path> FoldersOf(const std::string& file) {
  std::vector<fs::path> folders = {fs::path(file).parent_path()};
  std::error_code error;
  if (!fs::is_symlink(file, error)) return folders;
  const fs::path target = fs::canonical(file, error);
  if (error) return folders;
  const fs::path own = folders[0].empty() ? fs::path(".") : folders[0];
  if (!fs::equivalent(own, target.parent_path(), error)) folders.push_back(target.parent_path());
  return folders;
}

bool LeavesFolder(const std::string& model, const fs::path& file) {
  return std::ranges::all_of(FoldersOf(model), [&](const fs::path& folder) { return Leaves(folder, file); });
}

fs::path FindOnlyFile(const std::string& by, const std::string& name,
                      std::initializer_list<const char*> extensions) {
  if (std::ranges::all_of(name, [](char c) { return static_cast<unsigned char>(c) < 0x80; })) return {};
  fs::path found;
  for (const fs::path& folder : FoldersOf(by)) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder.empty() ? "." : folder, error)) {
      const std::string extension = entry.path().extension().string();
      const bool fits = std::ranges::any_of(
          extensions, [&](const char* known) { return EqualsIgnoringCase(extension, known); });
      if (!fits || !IsFile(entry.path())) continue;
      if (!found.empty()) return {};
      found = folder / entry.path().filename();
    }
  }
  if (!found.empty()) NoteModelFile(found.string());
  return found;
}

fs::path FindFile(const std::string& by, const std::string& name) {
  if (name.empty() || name.find('\0') != std::string::npos) return {};
  for (const fs::path& folder : FoldersOf(by))
    if (fs::path found = FindIn(folder, name); !found.empty()) return found;
  return {};
}

}  // namespace quarry

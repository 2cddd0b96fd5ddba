#include "preprocess/import/find_file.h"

#include <algorithm>
#include <system_error>

#include "preprocess/import/file_identity.h"
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

}  // namespace

bool LeavesFolder(const fs::path& folder, const fs::path& file) {
  const fs::path inside =
      fs::path(Slashed(file.string())).lexically_normal().lexically_relative(folder.lexically_normal());
  return inside.empty() || *inside.begin() == "..";
}

fs::path FindOnlyFile(const fs::path& folder, const std::string& name,
                      std::initializer_list<const char*> extensions) {
  if (std::ranges::all_of(name, [](char c) { return static_cast<unsigned char>(c) < 0x80; })) return {};
  fs::path found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? "." : folder, error)) {
    const std::string extension = entry.path().extension().string();
    const bool fits = std::ranges::any_of(
        extensions, [&](const char* known) { return EqualsIgnoringCase(extension, known); });
    if (!fits || !IsFile(entry.path())) continue;
    if (!found.empty()) return {};
    found = folder / entry.path().filename();
  }
  if (!found.empty()) NoteModelFile(found.string());
  return found;
}

fs::path FindFile(const fs::path& folder, const std::string& name) {
  if (name.empty() || name.find('\0') != std::string::npos) return {};
  const std::string slashed = Slashed(name);
  for (const fs::path& candidate : {folder / name, folder / slashed, folder / fs::path(slashed).filename()})
    if (NoteModelFile(candidate.string()); IsFile(candidate)) return candidate;
  fs::path found = FindWhateverCase(folder / slashed);
  if (!found.empty()) NoteModelFile(found.string());
  return found;
}

}  // namespace quarry

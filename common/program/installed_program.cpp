#include "common/program/installed_program.h"

#include <unistd.h>

#include <system_error>

namespace quarry {

std::vector<std::filesystem::path> ProgramFolders() {
  std::error_code error;
  const auto own = std::filesystem::read_symlink("/proc/self/exe", error).parent_path();
  // An installed program lies in one of the two folders, so one of each pair is the right one.
  return {own, (own / QUARRY_BIN_TO_LIBEXEC).lexically_normal(),
          (own / QUARRY_LIBEXEC_TO_BIN).lexically_normal()};
}

std::string FindProgram(const std::string& name) {
  for (const auto& folder : ProgramFolders())
    if (const auto path = folder / name; ::access(path.c_str(), X_OK) == 0) return path.string();
  return "";
}

}  // namespace quarry

#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace quarry {

/// The folders that hold Quarry's programs, in the order in which they are searched: this program's own (a
/// build folder has all programs in one), then bin and libexec/quarry of the installation around it, wherever
/// that has been moved to. They need not exist.
std::vector<std::filesystem::path> ProgramFolders();

/// The path of another of Quarry's programs. Returns: empty when no folder has it, or it may not be executed.
std::string FindProgram(const std::string& name);

}  // namespace quarry

#pragma once

#include <filesystem>
#include <string>

namespace quarry {

/// Finds the regular file that a model in `folder` means by `name`: relative to the folder, with slashes or
/// backslashes; else a file of that name beside the model; else a file whose name differs only in case.
/// Empty: there is none.
std::filesystem::path FindFile(const std::filesystem::path& folder, const std::string& name);

/// Whether `file` lies outside a model's `folder`, judged by the names alone. Models come from strangers, who
/// have no business with other files of the machine.
bool LeavesFolder(const std::filesystem::path& folder, const std::filesystem::path& file);

}  // namespace quarry

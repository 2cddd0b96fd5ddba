#pragma once

#include <filesystem>
#include <string>

namespace quarry {

/// The existing regular file that a model in `folder` means by `name`: relative to the folder, with slashes
/// or backslashes between folders; where that is not there, a file of that name beside the model, or one
/// whose name differs in the case of letters. Empty if there is none.
std::filesystem::path FindFile(const std::filesystem::path& folder, const std::string& name);

/// Whether `file` lies outside the `folder` of a model, by the names alone. A model comes from strangers, who
/// have no business with other files of the machine.
bool LeavesFolder(const std::filesystem::path& folder, const std::filesystem::path& file);

}  // namespace quarry

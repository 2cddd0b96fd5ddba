#pragma once

#include <filesystem>
#include <string>

namespace quarry {

/// The existing regular file that a model in `folder` means by `name`: relative to the folder, with slashes
/// or backslashes between folders; where that is not there, a file of that name beside the model. Empty if
/// there is none.
std::filesystem::path FindFile(const std::filesystem::path& folder, const std::string& name);

}  // namespace quarry

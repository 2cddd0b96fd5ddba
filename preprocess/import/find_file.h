#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>

namespace quarry {

/// Finds the regular file that a model in `folder` means by `name`: relative to the folder, with slashes or
/// backslashes; else a file of that name beside the model; else a file whose name differs only in case.
/// Empty: there is none.
std::filesystem::path FindFile(const std::filesystem::path& folder, const std::string& name);

/// The only regular file of `folder` with one of `extensions` (".mtl", in any case), for a name in an
/// encoding that the file system does not use. Empty: `name` is ASCII, or there is none, or there are
/// several.
std::filesystem::path FindOnlyFile(const std::filesystem::path& folder, const std::string& name,
                                   std::initializer_list<const char*> extensions);

/// Whether `file` lies outside a model's `folder`, judged by the names alone. Models come from strangers, who
/// have no business with other files of the machine.
bool LeavesFolder(const std::filesystem::path& folder, const std::filesystem::path& file);

}  // namespace quarry

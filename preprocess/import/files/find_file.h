#pragma once

#include <filesystem>
#include <initializer_list>
#include <string>
#include <vector>

namespace quarry {

/// The folders that names in a file are relative to: its own, then that of the file that it is a symbolic
/// link to. Examples: {"", "../shelf"}.
std::vector<std::filesystem::path> FoldersOf(const std::string& file);

/// Finds the regular file that `by`, a model or a file of it, means by `name`. One rule for all formats. For
/// each of FoldersOf(by): the name as it is, with slashes or backslashes; then ever fewer of its last parts,
/// since a name may be of another machine ("C:/plant/textures/a.png": "textures/a.png", "a.png"); then names
/// that differ in case alone. Empty: there is none.
std::filesystem::path FindFile(const std::string& by, const std::string& name);

/// The only regular file in the folders of `by` with one of `extensions` (".mtl", in any case), for a name in
/// an encoding that the file system does not use. Empty: `name` is ASCII, or there is none, or there are
/// several.
std::filesystem::path FindOnlyFile(const std::string& by, const std::string& name,
                                   std::initializer_list<const char*> extensions);

/// Whether `file` lies outside of `model`'s folders, judged by the names alone. A model from a stranger must
/// not use other files of the machine: readers warn of such a file, or refuse it.
bool LeavesFolder(const std::string& model, const std::filesystem::path& file);

}  // namespace quarry

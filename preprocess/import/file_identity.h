#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace quarry {

/// A file as it must be found again by a run that goes on after it: its path, size and time. Notes it, as
/// NoteModelFile does.
std::string FileIdentity(const std::string& path);

/// A file that a model consists of, or that it names and that was looked for: as it was then.
struct ModelFile {
  std::string path;    ///< absolute
  bool there = false;  ///< a file that is missing may come to be there
  uint64_t bytes = 0;
  int64_t changed_ns = 0;  ///< time of its last change, since 1970
};

/// Notes a file for ModelFiles(), once. Standard input is none. Thread-safe.
void NoteModelFile(const std::string& path);

/// All files noted in this process, by path: what a store is made from. Thread-safe.
std::vector<ModelFile> ModelFiles();

}  // namespace quarry

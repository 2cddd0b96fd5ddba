#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace quarry {

/// The path, size and time of a file, as text: a resumed run compares it. Records the file as NoteModelFile()
/// does.
std::string FileIdentity(const std::string& path);

/// A file that a model consists of or names, in the state in which the import found it.
struct ModelFile {
  std::string path;    ///< absolute
  bool there = false;  ///< a missing file may appear later
  uint64_t bytes = 0;
  int64_t changed_ns = 0;         ///< time of its last change, in ns since 1970
  int64_t status_changed_ns = 0;  ///< the same of its bytes, name, mode or time: nobody can set it
};

/// Records a file for ModelFiles(), once. Standard input is ignored. Thread-safe.
void NoteModelFile(const std::string& path);

/// All files recorded in this process, by path: the store's inputs. Thread-safe.
std::vector<ModelFile> ModelFiles();

}  // namespace quarry

#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace quarry {

/// A file that a model consists of or names, in the state in which the import found it.
struct ModelFile {
  std::string path;    ///< absolute
  bool there = false;  ///< a missing file may appear later
  uint64_t bytes = 0;
  int64_t changed_ns = 0;         ///< time of its last change, in ns since 1970
  int64_t status_changed_ns = 0;  ///< the same of its bytes, name, mode or time: nobody can set it
};

/// Records a file for ModelFiles(), once. Standard input and the run's own files are ignored. Thread-safe.
void NoteModelFile(const std::string& path);

/// Declares that the files whose paths begin with `prefix` are made by this run, so that they are no inputs
/// of the store. Thread-safe.
void DisownModelFiles(const std::string& prefix);

/// All files recorded in this process, by path: the store's inputs. Thread-safe.
std::vector<ModelFile> ModelFiles();

/// Records a file as an earlier run found it. Returns false if it has changed since. Thread-safe.
bool RestoreModelFile(const ModelFile& file);

}  // namespace quarry

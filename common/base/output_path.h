#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace quarry {

// Every path that a program writes comes through here, before any work: what lies there already decides.

/// Where an output really goes.
struct OutputPlace {
  std::string path;     ///< with symbolic links followed: a link's target is replaced, and the link stays
  bool stream = false;  ///< a device or FIFO: written to as it is, and nothing is ever renamed over it
};

/// Errors (usage): a folder, a disk, a socket, links in a circle, no name at all.
Result<OutputPlace> PlaceOf(const std::string& path);

/// What a program writes: a file of the same kind may be replaced by it.
struct OutputKind {
  const char* name;                      ///< "a PNG image"
  bool (*fits)(std::string_view start);  ///< whether a file that begins so (some 4 KiB) is of this kind
  bool streams;                          ///< whether it can go to a device or FIFO
};
/// The kinds that several programs know.
extern const OutputKind kPngOutput, kExrOutput, kStatisticsOutput, kTraceOutput, kFiguresOutput;

/// Decides about the outputs of one run. Rules: an output is no input (other spellings, hard links and
/// symbolic links included), nor another output; a regular file that is not empty and of another kind is
/// replaced with `force` only. Not thread-safe.
class OutputGuard {
 public:
  enum class Force { kNo, kYes, kNotOffered };  ///< the last: the program has no --force
  explicit OutputGuard(Force force) : force_(force) {}

  /// `path` is read in this run. What is not there, or no file ("-"), is passed over.
  void AddInput(const std::string& path);
  /// The place of `path`, to which `kind` may be written. Errors (usage): as the rules say, and PlaceOf's.
  Result<OutputPlace> Take(const std::string& path, const OutputKind& kind);
  /// The same for a folder that the program fills. Errors (usage): a file is there, or a device.
  static Status TakeFolder(const std::string& path);

 private:
  struct Known {
    std::string path;
    uint64_t device, inode;
  };
  Force force_;
  std::vector<Known> inputs_;
  std::vector<std::pair<std::string, std::string>> outputs_;  ///< as given, and in one spelling
};

/// A file is read in this run: told by whoever opens what a model names, known to no guard beforehand.
/// Thread-safe.
void NoteRead(const std::string& path);
/// Errors (usage): an OutputGuard has taken `path`, and the file there has been read since. Thread-safe.
Status CheckNotRead(const std::string& path);

}  // namespace quarry

#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/base/status.h"

namespace quarry {

// Every path that a program writes is checked here before any work: the existing file decides.

/// The place where an output is really written.
struct OutputPlace {
  std::string path;     ///< symbolic links followed: the link's target is replaced, the link stays
  bool stream = false;  ///< a device or FIFO: written to directly, never renamed over
};

/// Finds the place of `path`. Errors (usage): a folder, a disk, a socket, a circle of links, an empty name.
Result<OutputPlace> PlaceOf(const std::string& path);

/// The name of a file beside `path` that belongs to it: `path` with `suffix` at its end. Where the file
/// system takes no name so long, a hash stands for the end of the name. The same in every run.
std::string BesidePath(const std::string& path, std::string_view suffix);

/// A kind of file that a program writes. An output may replace a file of the same kind.
struct OutputKind {
  const char* name;                      ///< for messages: "a PNG image"
  bool (*fits)(std::string_view start);  ///< whether a file whose first 4 KiB are `start` is of this kind
  bool streams;                          ///< whether a device or FIFO can take it
};
/// Kinds that several programs write.
extern const OutputKind kPngOutput, kExrOutput, kStatisticsOutput, kViewOutput, kTraceOutput, kFiguresOutput;

/// Checks the outputs of one run. An output must not be an input (hard links, symbolic links and other
/// spellings included) or another output. A regular file that is not empty and of another kind is replaced
/// only with `force`. Not thread-safe.
class OutputGuard {
 public:
  enum class Force { kNo, kYes, kNotOffered };  ///< kNotOffered: the program has no --force
  explicit OutputGuard(Force force) : force_(force) {}

  /// Names a file that this run reads. Ignores paths that do not exist ("-").
  void AddInput(const std::string& path);
  /// Finds the place of `path` for an output of `kind`. Errors (usage): a rule above is broken; as PlaceOf().
  Result<OutputPlace> Take(const std::string& path, const OutputKind& kind);
  /// Checks a folder that the program fills. Errors (usage): empty name; something other than a folder is
  /// there.
  static Status TakeFolder(const std::string& path);

 private:
  struct Known {
    std::string path;
    uint64_t device, inode;
  };
  Force force_;
  std::vector<Known> inputs_;
  std::vector<std::pair<std::string, std::string>> outputs_;  ///< path as given, canonical path
};

/// Records that this run reads `path`. Called wherever a file is opened whose name comes from a model, since
/// no guard knows that file in advance. Thread-safe.
void NoteRead(const std::string& path);
/// Errors (usage): an OutputGuard took `path`, and the file there has been read since. Thread-safe.
Status CheckNotRead(const std::string& path);

}  // namespace quarry

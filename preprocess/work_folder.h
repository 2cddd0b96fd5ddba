#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"

namespace quarry {

/// What a run has done so far.
enum class CheckpointKind : uint32_t {
  kImported = 1,  ///< so many models, and perhaps a part of the next: the sink's state
  kRegions,       ///< the tree of regions
  kRouted,        ///< so many triangles are in the files of their regions
  kBuilt,         ///< the next region's voxels are in the store
  kTextures,      ///< and so many images
};

struct SavedCheckpoint {
  CheckpointKind kind;
  Bytes bytes;
};

/// The folder "OUTPUT.work" (and one for large files elsewhere, if that is wanted): the files of a run that
/// another may go on with, however it ended, and the journal of notes that says how far they can be believed.
/// A note is appended with its checksum and synchronised; what it speaks of must be on disk before. A signal,
/// a failure or the end of a run that has no notes removes all; one that has notes leaves them on a signal or
/// failure. Whatever the moment of a signal, a folder that is left is named by the signal's line. Movable.
/// Not thread-safe.
class WorkFolder {
 public:
  /// `spill`: where large files go; empty: here. `command`: what the result depends on, as lines "NAME
  /// VALUE". With `resume`, goes on with what lies there; without, begins anew. `goes_on`: for the sentence
  /// that names a folder that is left, how to go on. Errors: cannot be written; on
  /// resuming, was begun by another command (the first line that differs is named).
  static Result<WorkFolder> Open(const std::string& output, const std::string& spill,
                                 const std::string& command, bool resume, const std::string& goes_on);
  WorkFolder(WorkFolder&& other) noexcept;
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder();

  const std::string& path() const { return path_; }
  const std::string& spill_folder() const { return spill_; }
  std::string store() const { return path_ + "/store"; }
  const std::vector<SavedCheckpoint>& checkpoints() const { return checkpoints_; }
  /// Errors: disk full.
  Status Add(CheckpointKind kind, const Bytes& bytes);
  /// Whether a later run could go on from here.
  bool kept() const { return kept_; }
  /// The run is over: nothing is left.
  void Remove();

 private:
  WorkFolder() = default;
  Status Begin(const std::string& command);
  Result<bool> GoOn(const std::string& command);
  void HoldOnSignal();
  void KeepOnSignal();

  std::string path_, spill_;
  int journal_ = -1;
  std::vector<SavedCheckpoint> checkpoints_;
  bool kept_ = false;
  std::vector<int> cleanups_;  ///< see RemoveOnSignal
};

}  // namespace quarry

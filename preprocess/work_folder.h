#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"

namespace quarry {

/// Kinds of checkpoints in a run's journal.
enum class CheckpointKind : uint32_t {
  kImported = 1,  ///< all models read: the sink's state
  kRegions,       ///< the tree of regions
  kRouted,        ///< triangles in the files of their regions
  kSmoothed,      ///< regions whose borders are smoothed, and the normals in the files of all
  kBuilt,         ///< the next region's voxels are in the store
  kTextures,      ///< the next images are in the store
};

struct SavedCheckpoint {
  CheckpointKind kind;
  Bytes bytes;
};

/// The folder "OUTPUT.work", with a second folder for spill if that is wanted: the files of a run that a
/// later run may continue, and the journal of checkpoints up to which they are valid. A checkpoint has a
/// checksum; files that it names must be written out before. In the first seconds of a run, checkpoints
/// survive its process alone: few runs are worth waiting for the disk so early. From then on they survive a
/// loss of power too, with all files in the folders. The journal tells by the system's boot which ones hold.
/// A run without checkpoints removes its folders when it ends, fails or gets a signal. A run with checkpoints
/// leaves them on a failure or signal, and the signal's line names them. Movable. Thread safety: none.
class WorkFolder {
 public:
  struct Durability {
    std::string boot = BootId();  ///< of the running system; empty: unknown, and every checkpoint is durable
    double after_s = 20;          ///< seconds after Open() from which on checkpoints are durable
  };
  static std::string BootId();

  /// `spill`: the folder for large files; empty: OUTPUT.work. `command`: the settings that the store depends
  /// on, as lines "NAME VALUE". `resume`: continue, instead of beginning anew. `goes_on`: for the user, how
  /// to continue. Errors: cannot be written; the journal was begun by another command (the sentence names the
  /// first line that differs).
  static Result<WorkFolder> Open(const std::string& output, const std::string& spill,
                                 const std::string& command, bool resume, const std::string& goes_on,
                                 Durability durability);
  static Result<WorkFolder> Open(const std::string& output, const std::string& spill,
                                 const std::string& command, bool resume, const std::string& goes_on) {
    return Open(output, spill, command, resume, goes_on, Durability());
  }
  WorkFolder(WorkFolder&& other) noexcept;
  WorkFolder& operator=(WorkFolder&&) = delete;
  ~WorkFolder();

  const std::string& path() const { return path_; }
  const std::string& spill_folder() const { return spill_; }
  std::string store() const { return path_ + "/store"; }
  const std::vector<SavedCheckpoint>& checkpoints() const { return checkpoints_; }
  /// Appends checkpoints, each with its bytes. Errors: disk full.
  Status Add(CheckpointKind kind, std::span<const Bytes> checkpoints);
  Status Add(CheckpointKind kind, const Bytes& checkpoint) { return Add(kind, std::span(&checkpoint, 1)); }
  /// Whether a later run can continue from here.
  bool kept() const { return kept_; }
  /// Ends the run: removes everything.
  void Remove();

 private:
  WorkFolder() = default;
  Status Begin(const std::string& command);
  bool WasLost(std::span<const SavedCheckpoint> journal) const;
  Status Append(std::span<const std::byte> record);
  Status MakeDurable(CheckpointKind kind);
  Result<bool> GoOn(const std::string& command);
  void HoldOnSignal();
  void KeepOnSignal();

  std::string path_, spill_;
  int journal_ = -1;
  Durability durability_;
  std::chrono::steady_clock::time_point opened_ = std::chrono::steady_clock::now();
  bool durable_ = false;  ///< what the journal holds survives a loss of power
  std::vector<SavedCheckpoint> checkpoints_;
  bool kept_ = false;
  std::vector<int> cleanups_;  ///< see RemoveOnSignal()
};

}  // namespace quarry

#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/spill/spill_file.h"

namespace quarry {

/// Decides when an import makes a checkpoint, keeps its state in a file, and holds back the deletion of
/// files that the last checkpoint still names.
/// The state alternates between two files "FOLDER/import-state-N", so that the last complete state survives
/// a kill while the next is written. Thread safety: none.
class ImportCheckpoints {
 public:
  explicit ImportCheckpoints(std::string folder) : folder_(std::move(folder)) {}

  /// `make` records a checkpoint where a later process finds it. Without a `make` there are no checkpoints.
  void Every(double seconds, std::function<Status()> make);

  /// `elements`: vertices and triangles that the sink has received so far, the clock's prompt. With
  /// `restored`, the last checkpoint lies within the file.
  void BeginFile(uint64_t elements, bool restored);
  void EndFile();
  /// The current file cannot be read a second time, so a checkpoint within it is useless.
  void SkipFile() { skips_file_ = true; }
  bool enabled() const { return make_ && !skips_file_; }

  /// Whether Every()'s time has passed. The clock is read once in 4,096 elements.
  bool Due(uint64_t elements);
  /// Makes a checkpoint within the current file. Errors: disk full.
  Status Make();
  /// The importer's own state at the last checkpoint in the current file; empty: there is none.
  Bytes importer_state;

  /// Writes `state` to the other of the two files, durably, and returns a reference to it: a few bytes.
  /// Errors: disk full.
  Result<Bytes> Write(const Bytes& state);
  /// The state that `reference`, from Write(), names. Errors: the file is absent or differs.
  Result<Bytes> Read(std::span<const std::byte> reference);
  /// The last reference is on disk: deletes the files that only earlier checkpoints name.
  void Committed();

  /// Deletes the import's old triangle file, or holds it until the next checkpoint while the last names it.
  void RetireTriangles(SpillFile file) { Retire(std::move(file), made_); }
  /// Does so with a file of the current model.
  void RetireModelFile(SpillFile file) { Retire(std::move(file), made_in_file_); }
  /// Whether files are held back, so that a checkpoint must follow before they are made anew.
  bool must_save() const { return !retired_.empty(); }
  /// Deletes the import's files other than the state's and `kept`: leftovers of a kill between a checkpoint
  /// and the deletion of retired files.
  void RemoveAllBut(std::vector<std::string> kept) const;

 private:
  void Retire(SpillFile file, bool named);
  std::string StatePath() const;

  std::string folder_;
  double seconds_ = 0;
  std::function<Status()> make_;
  std::chrono::steady_clock::time_point made_at_ = std::chrono::steady_clock::now();
  uint64_t asked_at_ = 0;  ///< elements when Due() last read the clock
  bool skips_file_ = false;
  bool made_ = false, made_in_file_ = false;
  uint8_t state_number_ = 0;
  std::vector<SpillFile> retired_;
};

}  // namespace quarry

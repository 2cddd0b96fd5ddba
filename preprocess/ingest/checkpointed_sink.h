#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <utility>

#include "common/base/bytes.h"
#include "common/base/status.h"
#include "preprocess/import/model_sink.h"
#include "preprocess/ingest/checkpoint.h"

namespace quarry {

/// A sink that tells how far files are read, and keeps the importer's side of checkpoints. Thread safety:
/// none.
class CheckpointedSink : public ModelSink {
 public:
  /// `folder`: of the checkpoints' files.
  explicit CheckpointedSink(std::string folder) : checkpoints_(std::move(folder)) {}

  /// Calls `make` so many seconds after the last checkpoint: within a file, and between passes over many
  /// waiting faces. `make` records the sink's state where a later process finds it, then calls Committed().
  void CheckpointEvery(double seconds, std::function<Status()> make) {
    checkpoints_.Every(seconds, std::move(make));
  }
  /// The state last saved is on disk: deletes the files that only earlier checkpoints name.
  void Committed() { checkpoints_.Committed(); }
  /// Whether a checkpoint must follow before the next file begins or the triangles are read.
  bool must_save() const { return checkpoints_.must_save(); }
  /// Calls `told` with the bytes read of the current file and its size.
  void OnRead(std::function<void(uint64_t done, uint64_t total)> told) { on_read_ = std::move(told); }

  void HasRead(uint64_t done, uint64_t total) override {
    if (on_read_) on_read_(done, total);
  }
  void ReadsOnce() override { checkpoints_.SkipFile(); }
  Status Checkpoint(const Bytes& state) override {
    checkpoints_.importer_state = state;
    return checkpoints_.Make();
  }
  std::span<const std::byte> LastCheckpoint() const override { return checkpoints_.importer_state; }

 protected:
  ImportCheckpoints checkpoints_;

 private:
  std::function<void(uint64_t, uint64_t)> on_read_;
};

}  // namespace quarry

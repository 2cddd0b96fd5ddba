#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/bytes.h"
#include "common/base/file_lock.h"
#include "common/base/status.h"
#include "common/voxel/catalog.h"

namespace quarry {

/// Bytes by age of files; finds the age above which files must be removed. Ages fall into bands of a
/// sixteenth of an octave, so its size is independent of the number of files. Pure; not thread-safe.
/// Units: ages in ms.
class AgeHistogram {
 public:
  void Add(int64_t age_ms, uint64_t bytes);
  uint64_t total() const { return total_; }
  /// The point to remove at least `excess` bytes: all bands older than `band` hold less than `excess` bytes,
  /// and together with `band` they hold at least `excess`. Requires: 0 < excess <= total().
  struct Cut {
    uint32_t band = 0;   ///< files in older (greater) bands are removed
    uint64_t bytes = 0;  ///< and about this many bytes of files in `band`
  };
  Cut CutFor(uint64_t excess) const;
  static uint32_t BandOf(int64_t age_ms);

 private:
  static constexpr uint32_t kBands = 1024;
  std::array<uint64_t, kBands> bytes_{};
  uint64_t total_ = 0;
};

/// A folder of stored blocks, one file each: FOLDER/SCENE/BLOCK, where BLOCK is the block's number. Several
/// processes may use one folder for any scenes at once: files appear whole, by rename, and no file is locked.
/// Damage after a crash or a loss of power shows in the checksum. Temporaries are in FOLDER/writer-RANDOM,
/// which belongs to one CacheFolder while it lives (FOLDER/writer-RANDOM.lock); the next Open() removes the
/// folders of dead writers. Not thread-safe.
class CacheFolder {
 public:
  /// The result of a Read(): read, not there, or damaged and removed.
  enum class Found { kYes, kNo, kDamaged };

  /// Touches nothing before Open(). `budget` limits the bytes over all scenes; each file counts rounded up to
  /// 4 KiB.
  CacheFolder(std::string folder, uint64_t budget);
  ~CacheFolder();
  CacheFolder(const CacheFolder&) = delete;
  CacheFolder& operator=(const CacheFolder&) = delete;

  /// Makes the folder if needed, removes temporaries of dead writers and becomes a writer. Read() works
  /// without Open().
  /// Errors: the folder cannot be made or written.
  Status Open();

  /// Reads a block into `out` if a file with the size and checksum of `entry` exists; removes a damaged file.
  /// A file's modification time is the time of its last use, to a minute.
  /// Errors: cannot be read.
  Result<Found> Read(const SceneId& scene, uint32_t block, const BlockEntry& entry, Bytes& out);

  /// Writes a block. A block larger than the whole budget is not written.
  /// Errors: disk full and other write errors; no partial file remains.
  Status Write(const SceneId& scene, uint32_t block, std::span<const std::byte> bytes);

  /// Whether enough bytes were written that Sweep() should run.
  bool SweepDue() const { return sweep_ != nullptr || written_ >= next_sweep_; }
  /// Continues a search through the folder, 256 files per call, so that reads can come between. It sums the
  /// sizes; when they exceed the budget it removes the least recently used files until an eighth of the
  /// budget is free. Files that other processes remove meanwhile count as removed.
  void Sweep();

  uint64_t evicted() const { return evicted_; }  ///< files removed by sweeps
  const std::string& path() const { return folder_; }

 private:
  struct Walk;
  std::string BlockPath(const SceneId& scene, uint32_t block) const;
  Status BecomeWriter();
  void EndSweep(uint64_t left);
  void RemoveDeadWriters();
  Status WriteOnce(const SceneId& scene, uint32_t block, std::span<const std::byte> bytes, int& error);

  std::string folder_;
  uint64_t budget_;
  std::string writer_;  ///< the folder of temporaries; empty when this is no writer
  std::optional<FileLock> lock_;
  int cleanup_ = -1;  ///< handle of RemoveOnSignal()
  uint64_t temporaries_ = 0;
  uint64_t written_ = 0;     ///< bytes since the last sweep began
  uint64_t next_sweep_ = 0;  ///< bytes after which a sweep is due
  uint64_t evicted_ = 0;
  std::unique_ptr<Walk> sweep_;
};

}  // namespace quarry

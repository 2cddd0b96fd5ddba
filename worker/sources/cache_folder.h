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

/// Bytes by age, from which follows how old the files are that have to go. Ages fall into bands of a
/// sixteenth of an octave, so that its size does not grow with the number of files. Pure.
class AgeHistogram {
 public:
  void Add(int64_t age_ms, uint64_t bytes);
  uint64_t total() const { return total_; }
  /// The band of which the older ones hold less than `excess` bytes, and together with it at least that.
  /// Requires: 0 < excess <= total().
  struct Cut {
    uint32_t band = 0;   ///< files of older (greater) bands go
    uint64_t bytes = 0;  ///< and of this band about as many bytes
  };
  Cut CutFor(uint64_t excess) const;
  static uint32_t BandOf(int64_t age_ms);

 private:
  static constexpr uint32_t kBands = 1024;
  std::array<uint64_t, kBands> bytes_{};
  uint64_t total_ = 0;
};

/// A folder of blocks, a file each: FOLDER/SCENE/BLOCK. Several processes may use one folder at once, over
/// all scenes: files appear whole, by renaming, and nothing is locked while one works. What a crash or a loss
/// of power may do to a file shows in its checksum. Temporaries lie in FOLDER/writer-RANDOM, which belongs to
/// one CacheFolder for as long as it lives (FOLDER/writer-RANDOM.lock); those of dead ones are removed by
/// the next Open. Not thread-safe.
class CacheFolder {
 public:
  enum class Found { kYes, kNo, kDamaged };

  /// Nothing is touched before Open. `budget`: bytes over all scenes, each file rounded up to 4 KiB.
  CacheFolder(std::string folder, uint64_t budget);
  ~CacheFolder();
  CacheFolder(const CacheFolder&) = delete;
  CacheFolder& operator=(const CacheFolder&) = delete;

  /// Makes the folder if need be, removes what dead writers left, becomes a writer. Reading needs no Open.
  /// Errors: the folder cannot be made or written.
  Status Open();

  /// The block into `out`, if it is there with the size and checksum of `entry`; a damaged one is removed.
  /// A file's time of change is the time it was last used, to a minute. Errors: cannot be read.
  Result<Found> Read(const SceneId& scene, BlockKey block, const BlockEntry& entry, Bytes& out);

  /// One larger than the whole budget is not written. Errors: disk full and other write errors; nothing is
  /// left of the file then.
  Status Write(const SceneId& scene, BlockKey block, std::span<const std::byte> bytes);

  /// Whether enough was written that the folder ought to be looked through: see Sweep.
  bool SweepDue() const { return sweep_ != nullptr || written_ >= next_sweep_; }
  /// Goes on looking through the folder, a few hundred files a call, so that reads can come between: sums up
  /// the sizes, and when they are over the budget removes the least recently used until an eighth of it
  /// is free. Files that other processes remove meanwhile count as removed.
  void Sweep();

  uint64_t evicted() const { return evicted_; }  ///< files
  const std::string& path() const { return folder_; }

 private:
  struct Walk;
  std::string BlockPath(const SceneId& scene, BlockKey block) const;
  Status BecomeWriter();
  void EndSweep(uint64_t left);
  void RemoveDeadWriters();
  Status WriteOnce(const SceneId& scene, BlockKey block, std::span<const std::byte> bytes, int& error);

  std::string folder_;
  uint64_t budget_;
  std::string writer_;  ///< the folder of temporaries; empty: none
  std::optional<FileLock> lock_;
  int cleanup_ = -1;  ///< see RemoveOnSignal
  uint64_t temporaries_ = 0;
  uint64_t written_ = 0;     ///< bytes since the last sweep
  uint64_t next_sweep_ = 0;  ///< bytes after which one is due
  uint64_t evicted_ = 0;
  std::unique_ptr<Walk> sweep_;
};

}  // namespace quarry

#pragma once

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "common/base/file_lock.h"
#include "common/base/status.h"
#include "common/protocol/messages.h"

namespace quarry {

/// Jobs on disk, so that a master that is started again goes on with them: a folder a job, in it the job as
/// it was asked for and its finished frames, each written whole or not at all. Thread-safe after Open.
class Spool {
 public:
  /// Makes the folder if need be. `scene`: jobs of other scenes are left alone. Errors: it cannot be made or
  /// read, another master is at work on it.
  static Result<Spool> Open(const std::string& folder, const SceneId& scene);

  struct Found {
    std::string id;
    RenderJob job;
    std::vector<bool> finished;  ///< by frame
    uint32_t tries = 0;  ///< masters that have begun a frame of it, and have ended before any was finished
  };
  /// A job that so many masters have tried is set aside.
  static constexpr uint32_t kMostTries = 3;
  /// Jobs that were begun, the oldest first; a damaged one is named by `log` and left alone. One that has had
  /// its tries is renamed to ID.set-aside, which `log` is told.
  std::vector<Found> Jobs(const std::function<void(const std::string&)>& log) const;

  /// Errors: the disk is full or cannot be written.
  Status Begin(const std::string& id, const RenderJob& job) const;
  /// Counts a try, on disk before it returns. Where that cannot be written the try is not counted.
  void NoteTry(const std::string& id) const;
  /// Errors: such a job was set aside; the sentence says where it is, and what to do.
  Status CheckNotSetAside(const std::string& id) const;
  /// Its job's tries are forgotten with it.
  Status WriteFrame(const std::string& id, const RenderJob& job, size_t frame,
                    std::span<const std::byte> image) const;
  Result<Bytes> ReadFrame(const std::string& id, const RenderJob& job, size_t frame) const;
  void Remove(const std::string& id) const;

 private:
  Spool(std::string folder, const SceneId& scene, FileLock lock)
      : folder_(std::move(folder)), scene_(scene), lock_(std::make_unique<FileLock>(std::move(lock))) {}
  std::string JobPath(const std::string& id) const;
  std::string TriesPath(const std::string& id) const { return folder_ + "/" + id + "/tries"; }
  std::string AsidePath(const std::string& id) const { return folder_ + "/" + id + ".set-aside"; }
  uint32_t Tries(const std::string& id) const;
  std::string FramePath(const std::string& id, const RenderJob& job, size_t frame) const;
  std::string folder_;
  SceneId scene_;
  std::unique_ptr<FileLock> lock_;
};

/// A name for a job that depends on the scene and on all that its pictures do: the same job asked for twice
/// is one.
std::string JobId(const SceneId& scene, const RenderJob& job);

}  // namespace quarry

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

/// Jobs on disk, which a restarted master continues. Each job has a folder with the request
/// and the finished frames, each file written whole or not at all, and with a checksum: a frame's is 8 bytes
/// after its picture. Links in the folder are neither read nor written through. Thread-safe after Open.
class Spool {
 public:
  /// Makes the folder if need be. `scene`: jobs of other scenes are left alone.
  /// Errors: the folder cannot be made or read, or another master uses it.
  static Result<Spool> Open(const std::string& folder, const SceneId& scene);

  struct Found {
    std::string id;
    RenderJob job;
    std::vector<bool> finished;  ///< by frame
    uint32_t tries = 0;          ///< masters that have begun a frame and ended before one was finished
  };
  /// Tries after which a job is set aside: it may be the cause of the masters' ends.
  static constexpr uint32_t kMostTries = 3;
  /// Jobs that were begun, the oldest first. A damaged job is left alone, and a job that has had kMostTries
  /// is renamed to ID.set-aside; `log` gets a line for both.
  std::vector<Found> Jobs(const std::function<void(const std::string&)>& log) const;

  /// Errors: the disk is full or cannot be written.
  Status Begin(const std::string& id, const RenderJob& job) const;
  /// Counts a try, on disk before it returns; not counted where the disk cannot be written.
  void NoteTry(const std::string& id) const;
  /// Uncounts the last try: the master ends on request.
  void TakeBackTry(const std::string& id) const;
  /// Errors: the job was set aside; the sentence names its place and the way to try it again.
  Status CheckNotSetAside(const std::string& id) const;
  /// Writes a finished frame and resets the job's tries. Errors: the disk is full or cannot be written.
  Status WriteFrame(const std::string& id, const RenderJob& job, size_t frame,
                    std::span<const std::byte> image) const;
  /// Errors: no such frame; a link; damaged, or another frame's file.
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

/// The job's name: a hash of the scene and of everything that decides the job's pictures.
std::string JobId(const SceneId& scene, const RenderJob& job);

}  // namespace quarry

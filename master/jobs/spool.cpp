#include "master/jobs/spool.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <string_view>

#include "common/base/descriptor.h"
#include "common/base/file.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

constexpr size_t kMostJobBytes = 16u << 20;

bool IsJobFolder(const std::string& name) {
  return name.size() == 16 && name.find_first_not_of("0123456789abcdef") == std::string::npos;
}

/// Removes files that a master was writing when it was killed.
void RemoveTemporaries(const fs::path& folder) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.path().filename().string().find(".tmp-") != std::string::npos)
      fs::remove(entry.path(), ignored);
}

/// A file that masters write into a job's folder.
bool IsOurs(const fs::path& file) {
  const std::string name = file.filename().string(), frame = file.stem().string();
  if (name == "job" || name == "tries") return true;
  const bool image = file.extension() == ".png" || file.extension() == ".exr";
  return image && !frame.empty() && frame.find_first_not_of("0123456789") == std::string::npos;
}

/// Removes a job that a master was beginning or removing when it was killed. Another program's folder that
/// happens to have such a name keeps its files.
void RemoveRemains(const fs::path& folder) {
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(folder, ignored))
    if (entry.is_regular_file(ignored) && IsOurs(entry.path())) fs::remove(entry.path(), ignored);
  fs::remove(folder, ignored);  // if it is empty
}

/// Reads a file that a master has written. A link is not one, wherever it leads.
Result<Bytes> ReadOwn(const std::string& path, uint64_t most) {
  const OwnedDescriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK | O_NOCTTY));
  if (!file) return Fail(fmt::format("{}: cannot open: {}", path, ErrnoText(errno)));
  struct stat info {};
  if (::fstat(file.get(), &info) != 0 || !S_ISREG(info.st_mode))
    return Fail(fmt::format("{}: is not a regular file", path));
  if (static_cast<uint64_t>(info.st_size) > most)
    return Fail(fmt::format("{}: is too large for a file of the spool", path));
  Bytes bytes(static_cast<size_t>(info.st_size));
  if (!ReadAll(file.get(), bytes)) return Fail(fmt::format("{}: cannot be read", path));
  return bytes;
}

/// Writes a file of the spool. A link that lies in its place is removed, not written through.
Status WriteOwn(const std::string& path, std::span<const std::byte> bytes) {
  std::error_code ignored;
  if (const fs::file_status there = fs::symlink_status(path, ignored);
      fs::exists(there) && !fs::is_regular_file(there))
    fs::remove(path, ignored);
  return WriteFileAtomically(path, bytes);
}

bool IsRegular(const std::string& path) {
  std::error_code ignored;
  return fs::is_regular_file(fs::symlink_status(path, ignored));
}

bool IsFolder(const fs::path& path) {
  std::error_code ignored;
  return fs::is_directory(fs::symlink_status(path, ignored));
}

/// Bytes of the checksum after a frame's picture.
constexpr size_t kFrameEndBytes = sizeof(uint64_t);

/// The checksum of a frame: of its picture, and of its place, so that no frame is taken for another.
uint64_t FrameChecksum(const std::string& place, std::span<const std::byte> image) {
  return Checksum(AsBytes(place), image);
}

/// Checksum, scene, job.
Bytes PackJob(const SceneId& scene, const RenderJob& job) {
  ByteWriter out;
  out.PutArray(scene);
  out.PutArray(Encode(JobRequest{job, 0}));
  const Bytes content = out.Take();
  ByteWriter file;
  file.Put(Checksum(content));
  file.PutArray(content);
  return file.Take();
}

Result<RenderJob> UnpackJob(const SceneId& scene, std::span<const std::byte> file, bool& other_scene) {
  ByteReader in(file);
  const auto checksum = in.Get<uint64_t>();
  if (file.size() < 8 + scene.size() || Checksum(file.subspan(8)) != checksum)
    return Fail("is damaged (checksum)");
  const auto id = in.GetSpan(scene.size());
  other_scene = !std::equal(id.begin(), id.end(), std::as_bytes(std::span(scene)).begin());
  QUARRY_ASSIGN(JobRequest request, DecodeJobRequest(file.subspan(8 + scene.size())));
  return std::move(request.job);
}

}  // namespace

uint32_t Spool::Tries(const std::string& id) const {
  const auto bytes = ReadOwn(TriesPath(id), 64);
  uint32_t tries = 0;
  if (bytes) {
    const std::string_view text = AsText(*bytes);
    std::from_chars(text.data(), text.data() + text.size(), tries);
  }
  return tries;
}

void Spool::NoteTry(const std::string& id) const {
  std::error_code ignored;
  if (!fs::exists(folder_ + "/" + id, ignored)) return;  // its folder comes with a try in it, see Begin
  (void)WriteOwn(TriesPath(id), AsBytes(fmt::format("{}\n", Tries(id) + 1)));
}

void Spool::TakeBackTry(const std::string& id) const {
  const uint32_t tries = Tries(id);
  if (tries > 0) (void)WriteOwn(TriesPath(id), AsBytes(fmt::format("{}\n", tries - 1)));
}

Status Spool::CheckNotSetAside(const std::string& id) const {
  std::error_code ignored;
  if (!fs::exists(AsidePath(id), ignored)) return {};
  return Fail(
      fmt::format("this job has ended the master {} times and was moved to {}; remove that to try it again",
                  kMostTries, AsidePath(id)));
}

std::string JobId(const SceneId& scene, const RenderJob& job) {
  const Bytes packed = PackJob(scene, job);
  return fmt::format("{:016x}", Checksum(packed));
}

std::string Spool::JobPath(const std::string& id) const { return folder_ + "/" + id + "/job"; }

std::string Spool::FramePath(const std::string& id, const RenderJob& job, size_t frame) const {
  return fmt::format("{}/{}/{:04}.{}", folder_, id, job.first_frame + frame, job.format.name);
}

Result<Spool> Spool::Open(const std::string& folder, const SceneId& scene) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) return Fail(fmt::format("{}: cannot be made: {}", folder, error.message()));
  QUARRY_ASSIGN(FileLock lock, FileLock::Take(folder + "/jobs", "another quarry-master"));
  std::vector<fs::path> folders;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (IsFolder(entry.path()) && IsJobFolder(entry.path().filename().string()))
      folders.push_back(entry.path());
  for (const fs::path& path : folders) {
    RemoveTemporaries(path);
    if (!fs::exists(path / "job")) RemoveRemains(path);
  }
  if (error) return Fail(fmt::format("{}: cannot be read: {}", folder, error.message()));
  return Spool(folder, scene, std::move(lock));
}

std::vector<Spool::Found> Spool::Jobs(const std::function<void(const std::string&)>& log) const {
  std::vector<std::pair<fs::file_time_type, Found>> jobs;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    Found found{entry.path().filename().string(), {}, {}, 0};
    if (!IsFolder(entry.path()) || !IsJobFolder(found.id) || !fs::exists(JobPath(found.id))) continue;
    bool other_scene = false;
    auto bytes = ReadOwn(JobPath(found.id), kMostJobBytes);
    auto job = bytes ? UnpackJob(scene_, *bytes, other_scene)
                     : Result<RenderJob>(tl::unexpected<Error>(bytes.error()));
    if (!job) {
      log(fmt::format("{}: {}", JobPath(found.id), job.error().message));
      continue;
    }
    if (other_scene) continue;
    found.tries = Tries(found.id);
    if (found.tries >= kMostTries) {
      std::error_code cannot;
      fs::rename(folder_ + "/" + found.id, AsidePath(found.id), cannot);
      log(fmt::format("job {} has ended {} masters: it is set aside{}", found.id, found.tries,
                      cannot ? ", where it is" : fmt::format(" as {}", AsidePath(found.id))));
      continue;
    }
    found.job = std::move(*job);
    for (size_t f = 0; f < found.job.cameras.size(); ++f)
      found.finished.push_back(IsRegular(FramePath(found.id, found.job, f)));
    std::error_code ignored;
    jobs.push_back({fs::last_write_time(JobPath(found.id), ignored), std::move(found)});
  }
  std::sort(jobs.begin(), jobs.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Found> out;
  for (auto& [time, found] : jobs) out.push_back(std::move(found));
  return out;
}

Status Spool::Begin(const std::string& id, const RenderJob& job) const {
  std::error_code error;
  fs::create_directories(folder_ + "/" + id, error);
  if (error) return Fail(fmt::format("{}/{}: cannot be made: {}", folder_, id, error.message()));
  if (!IsFolder(folder_ + "/" + id))
    return Fail(fmt::format("{}/{}: is a link, not a job's folder; remove it", folder_, id));
  SyncFolderOf(folder_ + "/" + id);
  // Before the job itself: a job that ends the master at once has been tried.
  if (!fs::exists(TriesPath(id), error)) QUARRY_TRY(WriteOwn(TriesPath(id), AsBytes("1\n")));
  return WriteOwn(JobPath(id), PackJob(scene_, job));
}

Status Spool::WriteFrame(const std::string& id, const RenderJob& job, size_t frame,
                         std::span<const std::byte> image) const {
  const std::string path = FramePath(id, job, frame);
  ByteWriter file;
  file.PutArray(image);
  file.Put(FrameChecksum(path.substr(folder_.size()), image));
  QUARRY_TRY(WriteOwn(path, file.bytes()));
  std::error_code ignored;
  fs::remove(TriesPath(id), ignored);
  return {};
}

Result<Bytes> Spool::ReadFrame(const std::string& id, const RenderJob& job, size_t frame) const {
  const std::string path = FramePath(id, job, frame);
  QUARRY_ASSIGN(Bytes image, ReadOwn(path, 0xF0000000u));
  if (image.size() < kFrameEndBytes) return Fail(fmt::format("{}: is damaged (too short)", path));
  uint64_t checksum = 0;
  std::memcpy(&checksum, image.data() + image.size() - kFrameEndBytes, kFrameEndBytes);
  image.resize(image.size() - kFrameEndBytes);
  if (FrameChecksum(path.substr(folder_.size()), image) != checksum)
    return Fail(fmt::format("{}: is damaged (checksum)", path));
  return image;
}

void Spool::Remove(const std::string& id) const {
  std::error_code ignored;
  fs::remove(JobPath(id), ignored);  // first: a master that is killed meanwhile must not do it all again
  fs::remove_all(folder_ + "/" + id, ignored);
}

}  // namespace quarry

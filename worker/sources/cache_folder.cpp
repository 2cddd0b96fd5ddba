#include "worker/sources/cache_folder.h"

#include <dirent.h>
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <random>
#include <utility>

#include "common/base/check.h"
#include "common/base/cleanup.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

// Limit of the time that one Sweep() call delays reads.
constexpr int kFilesPerSweepCall = 256;
// Resolution of a file's last use in ms: a finer one costs a write for each read.
constexpr int64_t kTouchAfterMs = 60'000;
// Bytes; the allocation unit of common file systems.
constexpr uint64_t kBlockOfDisk = 4096;
constexpr std::string_view kWriterPrefix = "writer-", kLock = ".lock";

uint64_t OnDisk(int64_t size) {
  return (static_cast<uint64_t>(size) + kBlockOfDisk - 1) / kBlockOfDisk * kBlockOfDisk;
}

int64_t NowMs() {
  using namespace std::chrono;
  return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

int64_t ChangedMs(const struct stat& info) {
  return static_cast<int64_t>(info.st_mtim.tv_sec) * 1000 + info.st_mtim.tv_nsec / 1'000'000;
}

bool IsSceneFolder(std::string_view name) {
  return name.size() == 32 && name.find_first_not_of("0123456789abcdef") == std::string_view::npos;
}

bool IsBlockFile(std::string_view name) {
  return !name.empty() && name.size() <= 10 && name.find_first_not_of("0123456789") == std::string_view::npos;
}

struct OpenFd {
  ~OpenFd() {
    if (fd >= 0) ::close(fd);
  }
  int fd;
};

struct CloseFolder {
  void operator()(DIR* d) const { ::closedir(d); }
};
using Folder = std::unique_ptr<DIR, CloseFolder>;

/// The names in folder `path` for which `is` holds; none when the folder cannot be read.
template <class Is>
std::vector<std::string> Names(const std::string& path, Is&& is) {
  std::vector<std::string> names;
  const Folder folder(::opendir(path.c_str()));
  while (folder) {
    const dirent* entry = ::readdir(folder.get());
    if (!entry) break;
    if (is(std::string_view(entry->d_name))) names.emplace_back(entry->d_name);
  }
  return names;
}

std::string RandomName() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}", random(), random());
}

}  // namespace

uint32_t AgeHistogram::BandOf(int64_t age_ms) {
  // Bands of a sixteenth of an octave: only the order of ages matters, not exact values.
  const double octaves = std::log2(static_cast<double>(std::max<int64_t>(age_ms, 0)) + 1);
  return std::min(kBands - 1, static_cast<uint32_t>(octaves * 16));
}

void AgeHistogram::Add(int64_t age_ms, uint64_t bytes) {
  bytes_[BandOf(age_ms)] += bytes;
  total_ += bytes;
}

AgeHistogram::Cut AgeHistogram::CutFor(uint64_t excess) const {
  QUARRY_CHECK(excess > 0 && excess <= total_);
  uint64_t older = 0;
  for (uint32_t band = kBands; band-- > 0;) {
    if (older + bytes_[band] >= excess) return {band, excess - older};
    older += bytes_[band];
  }
  return {};
}

/// A walk over all blocks of all scenes; a second walk follows when files must be removed.
struct CacheFolder::Walk {
  explicit Walk(const std::string& path) : folder(path), begun_ms(NowMs()) { Begin(); }

  void Begin() {
    scenes = Names(folder, IsSceneFolder);
    open.reset();
  }

  /// Finds the path and status of the next block. Returns: false at the end of the walk.
  bool Next(std::string& path, struct stat& info) {
    for (;;) {
      if (!open) {
        if (!scene.empty()) ::rmdir(scene.c_str());  // succeeds only if no block is left in the scene
        scene.clear();
        if (scenes.empty()) return false;
        scene = folder + "/" + scenes.back();
        scenes.pop_back();
        open.reset(::opendir(scene.c_str()));
        if (!open) continue;
      }
      const dirent* entry = ::readdir(open.get());
      if (!entry) {
        open.reset();
        continue;
      }
      if (!IsBlockFile(entry->d_name)) continue;
      path = scene + "/" + entry->d_name;
      if (::lstat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode)) return true;
    }
  }

  std::string folder;
  int64_t begun_ms;
  std::vector<std::string> scenes;
  std::string scene;  // the scene's folder being walked
  Folder open;
  AgeHistogram ages;
  std::optional<AgeHistogram::Cut> cut;  // set during the second walk
};

CacheFolder::CacheFolder(std::string folder, uint64_t budget) : folder_(std::move(folder)), budget_(budget) {}

CacheFolder::~CacheFolder() {
  if (writer_.empty()) return;
  std::error_code ignored;
  fs::remove_all(writer_, ignored);
  Forget(cleanup_);
}

std::string CacheFolder::BlockPath(const SceneId& scene, uint32_t block) const {
  return fmt::format("{}/{}/{}", folder_, FormatSceneId(scene), block);
}

Status CacheFolder::Open() {
  std::error_code error;
  fs::create_directories(folder_, error);
  if (error) return Fail(fmt::format("{}: cannot make the folder: {}", folder_, error.message()));
  RemoveDeadWriters();
  return BecomeWriter();
}

Status CacheFolder::BecomeWriter() {
  writer_.clear();
  lock_.reset();
  Forget(std::exchange(cleanup_, -1));
  const std::string name = fmt::format("{}/{}{}", folder_, kWriterPrefix, RandomName());
  // Takes the lock before it makes the folder: a process that sees the folder then finds it in use.
  QUARRY_ASSIGN(FileLock lock, FileLock::Take(name, "another process"));
  if (::mkdir(name.c_str(), 0777) != 0)
    return Fail(fmt::format("{}: cannot write: {}", folder_, ErrnoText(errno)));
  lock_.emplace(std::move(lock));
  writer_ = name;
  cleanup_ = RemoveOnSignal(writer_);
  return {};
}

void CacheFolder::RemoveDeadWriters() {
  std::vector<std::string> writers =
      Names(folder_, [](std::string_view n) { return n.starts_with(kWriterPrefix); });
  for (std::string& name : writers)
    if (name.ends_with(kLock)) name.resize(name.size() - kLock.size());
  std::ranges::sort(writers);
  // std::unique and not std::ranges::unique: clang 14, which builds the fuzz programs, rejects the latter's
  // result.
  writers.erase(std::unique(writers.begin(), writers.end()), writers.end());
  for (const std::string& name : writers) {
    const std::string path = folder_ + "/" + name;
    const auto lock = FileLock::Take(path, "a living writer");  // released and removed with the object
    std::error_code ignored;
    if (lock) fs::remove_all(path, ignored);
  }
}

Result<CacheFolder::Found> CacheFolder::Read(const SceneId& scene, uint32_t block, const BlockEntry& entry,
                                             Bytes& out) {
  const std::string path = BlockPath(scene, block);
  const OpenFd file{::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK)};
  if (file.fd < 0) {
    if (errno == ENOENT || errno == ENOTDIR) return Found::kNo;
    return Fail(fmt::format("{}: cannot open: {}", path, ErrnoText(errno)));
  }
  struct stat info {};
  if (::fstat(file.fd, &info) != 0)
    return Fail(fmt::format("{}: cannot examine: {}", path, ErrnoText(errno)));
  bool whole = S_ISREG(info.st_mode) && info.st_size == entry.stored;
  if (whole) {
    out.resize(entry.stored);
    size_t done = 0;
    while (done < out.size()) {
      const ssize_t n = ::read(file.fd, out.data() + done, out.size() - done);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return Fail(fmt::format("{}: cannot read: {}", path, ErrnoText(errno)));
      if (n == 0) break;
      done += static_cast<size_t>(n);
    }
    whole = done == out.size() && Checksum(out) == entry.checksum;
  }
  if (!whole) {
    ::unlink(path.c_str());
    return Found::kDamaged;
  }
  if (NowMs() - ChangedMs(info) > kTouchAfterMs) ::futimens(file.fd, nullptr);
  return Found::kYes;
}

Status CacheFolder::Write(const SceneId& scene, uint32_t block, std::span<const std::byte> bytes) {
  if (OnDisk(static_cast<int64_t>(bytes.size())) > budget_) return {};
  int error = 0;
  Status status = WriteOnce(scene, block, bytes, error);
  // The folder or a part of it was removed while in use: make it again and retry once.
  if (!status && error == ENOENT) {
    if (status = Open(); status) status = WriteOnce(scene, block, bytes, error);
  }
  return status;
}

Status CacheFolder::WriteOnce(const SceneId& scene, uint32_t block, std::span<const std::byte> bytes,
                              int& error) {
  const auto fail = [&](const std::string& path, int number) {
    error = number;
    return quarry::Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(number)));
  };
  if (writer_.empty()) return fail(folder_, ENOENT);
  const std::string temporary = fmt::format("{}/{}", writer_, temporaries_++);
  const OpenFd file{::open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0644)};
  if (file.fd < 0) return fail(temporary, errno);
  for (size_t done = 0; done < bytes.size();) {
    const ssize_t n = ::write(file.fd, bytes.data() + done, bytes.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      const int number = n < 0 ? errno : ENOSPC;
      ::unlink(temporary.c_str());
      return fail(temporary, number);
    }
    done += static_cast<size_t>(n);
  }
  const std::string path = BlockPath(scene, block);
  int renamed = ::rename(temporary.c_str(), path.c_str());
  // A sweep of another process may remove the empty folder before the rename.
  for (int attempt = 0; renamed != 0 && errno == ENOENT && attempt < 3; ++attempt) {
    ::mkdir(path.substr(0, path.rfind('/')).c_str(), 0777);
    renamed = ::rename(temporary.c_str(), path.c_str());
  }
  if (renamed != 0) {
    const int number = errno;
    ::unlink(temporary.c_str());
    return fail(path, number);
  }
  written_ += OnDisk(static_cast<int64_t>(bytes.size()));
  return {};
}

void CacheFolder::Sweep() {
  if (!sweep_) {
    sweep_ = std::make_unique<Walk>(folder_);
    written_ = 0;
  }
  std::string path;
  struct stat info {};
  for (int i = 0; i < kFilesPerSweepCall; ++i) {
    if (!sweep_->Next(path, info)) {
      const uint64_t total = sweep_->ages.total();
      if (sweep_->cut || total <= budget_) return EndSweep(sweep_->cut ? budget_ - budget_ / 8 : total);
      sweep_->cut = sweep_->ages.CutFor(total - (budget_ - budget_ / 8));
      sweep_->Begin();
      continue;
    }
    const int64_t age = sweep_->begun_ms - ChangedMs(info);
    const uint64_t bytes = OnDisk(info.st_size);
    if (!sweep_->cut) {
      sweep_->ages.Add(age, bytes);
      continue;
    }
    AgeHistogram::Cut& cut = *sweep_->cut;
    const uint32_t band = AgeHistogram::BandOf(age);
    if (band < cut.band || (band == cut.band && cut.bytes == 0)) continue;
    if (band == cut.band) cut.bytes -= std::min(cut.bytes, bytes);
    if (::unlink(path.c_str()) == 0) ++evicted_;
  }
}

void CacheFolder::EndSweep(uint64_t left) {
  // All writers share the free room: when each has written its share, the folder is full again.
  const auto writers = Names(folder_, [](std::string_view n) {
                         return n.starts_with(kWriterPrefix) && n.ends_with(kLock);
                       }).size();
  const uint64_t room = std::max(budget_ - std::min(budget_, left), budget_ / 16);
  next_sweep_ = std::max<uint64_t>(1, room / std::max<size_t>(1, writers));
  sweep_.reset();
}

}  // namespace quarry

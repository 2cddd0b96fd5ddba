#include "common/base/file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <filesystem>
#include <utility>
#include <vector>

#include "common/base/cleanup.h"

namespace quarry {
namespace {

constexpr size_t kBufferBytes = 1 << 20;  // large writes save system calls

Status WriteAll(int fd, const std::string& path, const char* bytes, size_t size, int64_t offset) {
  while (size > 0) {
    const ssize_t n = offset < 0 ? ::write(fd, bytes, size) : ::pwrite(fd, bytes, size, offset);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(n < 0 ? errno : ENOSPC)));
    bytes += n;
    size -= static_cast<size_t>(n);
    if (offset >= 0) offset += n;
  }
  return {};
}

/// Gives a file the mode of the file that it replaces: the next picture is as private as the one before.
void KeepModeOf(const std::string& path, int fd) {
  struct stat replaced {};
  if (::lstat(path.c_str(), &replaced) == 0 && S_ISREG(replaced.st_mode))
    (void)::fchmod(fd, replaced.st_mode & 0777);
}

/// Makes a file's bytes durable. Some devices (/dev/full, pipes) refuse that; a disk does not.
Status SyncFile(int fd, const std::string& path) {
  if (::fsync(fd) == 0 || errno == EINVAL || errno == EROFS) return {};
  return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
}

}  // namespace

Status SyncFilesIn(const std::string& path, const std::string& start) {
  std::error_code error;
  // All files are begun before any is waited for: with thousands, each would wait alone for an idle disk.
  for (const bool waits : {false, true}) {
    std::filesystem::directory_iterator entry(path, error);
    for (; !error && entry != std::filesystem::directory_iterator(); entry.increment(error)) {
      std::error_code gone;
      if (!entry->path().filename().string().starts_with(start) || !entry->is_regular_file(gone)) continue;
      const int fd = ::open(entry->path().c_str(), O_RDONLY | O_CLOEXEC);
      if (fd < 0 && errno == ENOENT) continue;  // it is gone again
      if (fd < 0)
        return Fail(fmt::format("{}: cannot be opened: {}", entry->path().string(), ErrnoText(errno)));
      Status synced;
      if (waits)
        synced = SyncFile(fd, entry->path());
      else
        (void)!::sync_file_range(fd, 0, 0, SYNC_FILE_RANGE_WRITE);
      ::close(fd);
      QUARRY_TRY(synced);
    }
    if (error) return Fail(fmt::format("{}: cannot be read: {}", path, error.message()));
  }
  SyncFolderOf(path + "/");
  return {};
}

void SyncFolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
  const int fd = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return;
  ::fsync(fd);
  ::close(fd);
}

namespace {

/// The folder that a relative path was looked up in, as text for a message; empty for an absolute path.
std::string LookedIn(const std::string& path) {
  char folder[4096];
  return path.starts_with('/') || !::getcwd(folder, sizeof folder)
             ? ""
             : fmt::format(" (looked for in {})", folder);
}

}  // namespace

Result<InputFile> InputFile::Open(const std::string& path) {
  // O_NONBLOCK: opening a FIFO would otherwise wait for a writer, perhaps forever.
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
  if (fd < 0)
    return Fail(
        fmt::format("{}: cannot open: {}{}", path, ErrnoText(errno), errno == ENOENT ? LookedIn(path) : ""));
  InputFile file(path, fd, 0);
  struct stat info {};
  if (::fstat(fd, &info) != 0) return Fail(fmt::format("{}: cannot examine: {}", path, ErrnoText(errno)));
  if (S_ISDIR(info.st_mode)) return Fail(fmt::format("{}: is a folder, not a file", path));
  if (!S_ISREG(info.st_mode)) return Fail(fmt::format("{}: is not a regular file", path));
  file.size_ = static_cast<uint64_t>(info.st_size);
  NoteRead(path);
  return file;
}

InputFile::InputFile(InputFile&& other) noexcept
    : path_(std::move(other.path_)), fd_(std::exchange(other.fd_, -1)), size_(other.size_) {}

InputFile& InputFile::operator=(InputFile&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(fd_, other.fd_);
  std::swap(size_, other.size_);
  return *this;
}

InputFile::~InputFile() {
  if (fd_ >= 0) ::close(fd_);
}

Status InputFile::ReadAt(uint64_t offset, std::span<std::byte> out) const {
  size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = ::pread(fd_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return Fail(fmt::format("{}: cannot read at byte {}: {}", path_, offset, ErrnoText(errno)));
    if (n == 0)
      return Fail(fmt::format("{}: truncated: {} bytes are needed at byte {}, and the file ends at {}", path_,
                              out.size(), offset, offset + done));
    done += static_cast<size_t>(n);
  }
  return {};
}

OutputFile::OutputFile(std::string path, std::string temporary, int fd, bool kept)
    : path_(std::move(path)),
      temporary_(std::move(temporary)),
      fd_(fd),
      kept_(kept),
      cleanup_(kept || stream() ? -1 : RemoveOnSignal(temporary_)) {
  buffer_.reserve(kBufferBytes);
}

Result<OutputFile> OutputFile::OpenStream(const std::string& path) {
  struct stat info {};
  const bool regular = ::stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode);
  // O_APPEND: when the shell sends standard output to a file, the file's other lines stay.
  const int fd =
      ::open(path.c_str(), O_WRONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY | (regular ? O_APPEND : 0));
  if (fd < 0 && errno == ENXIO)
    return BadUsage(fmt::format("{}: no program reads from this FIFO; start it first", path));
  if (fd < 0) return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
  ::fcntl(fd, F_SETFL, ::fcntl(fd, F_GETFL) & ~O_NONBLOCK);
  return OutputFile(path, "", fd, false);
}

Result<OutputFile> OutputFile::Create(const std::string& path) {
  QUARRY_ASSIGN(const OutputPlace place, PlaceOf(path));
  if (place.stream) return OpenStream(place.path);
  std::string temporary = BesidePath(place.path, fmt::format(".tmp-{}", ::getpid()));
  constexpr int kFlags = O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC;
  const SignalsHeld held;
  int fd = ::open(temporary.c_str(), kFlags, 0644);
  if (fd < 0 && errno == EEXIST) {  // left by a killed process with the same process id
    ::unlink(temporary.c_str());
    fd = ::open(temporary.c_str(), kFlags, 0644);
  }
  if (fd < 0 && errno == ENOENT)
    return Fail(fmt::format("{}: cannot write: its folder is not there; make it first", path));
  if (fd < 0) return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
  KeepModeOf(place.path, fd);
  return OutputFile(place.path, std::move(temporary), fd, false);
}

Result<OutputFile> OutputFile::Continue(const std::string& path, std::string temporary, uint64_t size) {
  QUARRY_ASSIGN(const OutputPlace place, PlaceOf(path));
  if (place.stream)
    return BadUsage(fmt::format("{}: is a device or FIFO, and the output must be a regular file", path));
  const int fd = ::open(temporary.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(fmt::format("{}: cannot write: {}", temporary, ErrnoText(errno)));
  OutputFile file(place.path, std::move(temporary), fd, true);
  struct stat info {};
  const auto end = static_cast<off_t>(size);
  if (::fstat(fd, &info) != 0 || info.st_size < end)
    return Fail(fmt::format("{}: is shorter than the earlier run left it; start again without --resume",
                            file.temporary_));
  if (::ftruncate(fd, end) != 0 || ::lseek(fd, end, SEEK_SET) != end)
    return Fail(fmt::format("{}: cannot write: {}", file.temporary_, ErrnoText(errno)));
  file.size_ = size;
  return file;
}

OutputFile::OutputFile(OutputFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::move(other.temporary_)),
      fd_(std::exchange(other.fd_, -1)),
      kept_(other.kept_),
      cleanup_(std::exchange(other.cleanup_, -1)),
      size_(other.size_),
      buffer_(std::move(other.buffer_)) {}

OutputFile::~OutputFile() {
  if (fd_ < 0) return;
  ::close(fd_);
  if (!kept_ && !stream()) ::unlink(temporary_.c_str());
  Forget(cleanup_);
}

Status OutputFile::Flush() {
  QUARRY_TRY(WriteAll(fd_, path_, buffer_.data(), buffer_.size(), -1));
  buffer_.clear();
  return {};
}

Status OutputFile::Write(std::span<const std::byte> bytes) {
  size_ += bytes.size();
  if (buffer_.size() + bytes.size() > kBufferBytes) QUARRY_TRY(Flush());
  if (bytes.size() >= kBufferBytes)
    return WriteAll(fd_, path_, reinterpret_cast<const char*>(bytes.data()), bytes.size(), -1);
  buffer_.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return {};
}

Status OutputFile::WriteAt(uint64_t offset, std::span<const std::byte> bytes) {
  if (stream())
    return Fail(fmt::format("{}: cannot write: a device or FIFO is written in order only", path_));
  QUARRY_TRY(Flush());
  return WriteAll(fd_, path_, reinterpret_cast<const char*>(bytes.data()), bytes.size(),
                  static_cast<int64_t>(offset));
}

Status OutputFile::Shorten(uint64_t size) {
  QUARRY_TRY(Flush());
  const auto end = static_cast<off_t>(size);
  if (::ftruncate(fd_, end) != 0 || ::lseek(fd_, end, SEEK_SET) != end)
    return Fail(fmt::format("{}: cannot write: {}", path_, ErrnoText(errno)));
  size_ = size;
  return {};
}

Status OutputFile::Commit() {
  QUARRY_TRY(CheckNotRead(path_));
  if (!stream()) KeepModeOf(path_, fd_);
  QUARRY_TRY(Flush());
  QUARRY_TRY(SyncFile(fd_, path_));
  if (!stream() && ::rename(temporary_.c_str(), path_.c_str()) != 0)
    return Fail(fmt::format("{}: cannot write: {}", path_, ErrnoText(errno)));
  ::close(std::exchange(fd_, -1));
  Forget(std::exchange(cleanup_, -1));
  if (!stream()) SyncFolderOf(path_);
  return {};
}

Status CheckWritable(const OutputPlace& place) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Create(place.path));
  // Kept open until the program ends: the FIFO's reader would take closing it for the end of the data.
  static std::vector<OutputFile> streams;
  if (place.stream) streams.push_back(std::move(file));
  return {};
}

Status WriteFile(const std::string& path, std::span<const std::byte> bytes) {
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  if (fd < 0) return Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
  Status written = WriteAll(fd, path, reinterpret_cast<const char*>(bytes.data()), bytes.size(), -1);
  if (::close(fd) != 0 && written)
    written = Fail(fmt::format("{}: cannot write: {}", path, ErrnoText(errno)));
  return written;
}

Status WriteFileAtomically(const std::string& path, std::span<const std::byte> bytes) {
  QUARRY_ASSIGN(OutputFile file, OutputFile::Create(path));
  QUARRY_TRY(file.Write(bytes));
  return file.Commit();
}

}  // namespace quarry

#include "scenes/output_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>

#include "common/base/check.h"
#include "common/base/output_path.h"

namespace quarry::scenes {
namespace {

constexpr size_t kBufferBytes = 1 << 20;

}  // namespace

Result<std::unique_ptr<OutputFile>> OutputFile::Create(const std::string& path) {
  QUARRY_ASSIGN(OutputPlace place, PlaceOf(path));
  if (place.stream)
    return BadUsage(fmt::format("{}: is a device or FIFO, and the output must be a regular file.", path));
  std::string temporary = fmt::format("{}.partial-{}", place.path, getpid());
  const int descriptor = open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  if (descriptor < 0)
    return Fail(
        fmt::format("{}: cannot be written: {}; choose another place with -o.", path, ErrnoText(errno)));
  struct stat replaced {};  // leaves its mode to the new file
  if (lstat(place.path.c_str(), &replaced) == 0 && S_ISREG(replaced.st_mode))
    (void)fchmod(descriptor, replaced.st_mode & 0777);
  return std::unique_ptr<OutputFile>(new OutputFile(std::move(place.path), std::move(temporary), descriptor));
}

OutputFile::OutputFile(std::string path, std::string temporary, int descriptor)
    : path_(std::move(path)),
      temporary_(std::move(temporary)),
      descriptor_(descriptor),
      buffer_(std::make_unique<char[]>(kBufferBytes)) {}

OutputFile::~OutputFile() {
  if (descriptor_ >= 0) close(descriptor_);
  if (!committed_) unlink(temporary_.c_str());
}

Error OutputFile::Failed() const {
  return Error{fmt::format(
      "{}: writing failed: {}; nothing is kept of it: make room, or choose another place with -o.", path_,
      ErrnoText(errno))};
}

Status OutputFile::Flush() {
  for (size_t done = 0; done < used_;) {
    const ssize_t written = write(descriptor_, buffer_.get() + done, used_ - done);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return tl::unexpected<Error>(Failed());
    done += static_cast<size_t>(written);
  }
  used_ = 0;
  return {};
}

Result<char*> OutputFile::Reserve(size_t size) {
  QUARRY_DCHECK(size <= 65536);
  if (used_ + size > kBufferBytes) QUARRY_TRY(Flush());
  return buffer_.get() + used_;
}

Status OutputFile::Write(std::string_view bytes) {
  while (!bytes.empty()) {
    const std::string_view piece = bytes.substr(0, 65536);
    QUARRY_ASSIGN(char* room, Reserve(piece.size()));
    std::memcpy(room, piece.data(), piece.size());
    Advance(piece.size());
    bytes.remove_prefix(piece.size());
  }
  return {};
}

Status OutputFile::Patch(uint64_t offset, std::string_view bytes) {
  QUARRY_TRY(Flush());
  const ssize_t written = pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
  if (written != static_cast<ssize_t>(bytes.size())) return tl::unexpected<Error>(Failed());
  return {};
}

Status OutputFile::Close() {
  QUARRY_TRY(Flush());
  const int closed = close(descriptor_);
  descriptor_ = -1;
  if (closed != 0) return tl::unexpected<Error>(Failed());
  return {};
}

Status OutputFile::Commit() {
  if (std::rename(temporary_.c_str(), path_.c_str()) != 0) return tl::unexpected<Error>(Failed());
  committed_ = true;
  return {};
}

}  // namespace quarry::scenes

#include "preprocess/spill_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace quarry {
namespace {

tl::unexpected<Error> CannotMake(const std::string& place) {
  return Fail(fmt::format("{}: cannot make temporary files here: {} (choose a folder with --tmp)", place,
                          ErrnoText(errno)));
}

tl::unexpected<Error> CannotWrite(const std::string& place, int error) {
  return Fail(fmt::format("{}: cannot write temporary files: {} (choose another folder with --tmp)", place,
                          ErrnoText(error)));
}

tl::unexpected<Error> CannotRead(const std::string& place, int error) {
  return Fail(fmt::format("{}: cannot read temporary files back: {}{}", place, ErrnoText(error),
                          error == ENOENT ? "; begin anew without --resume" : ""));
}

/// One that is closed in the end.
class Descriptor {
 public:
  Descriptor(const std::string& path, int flags) : fd_(::open(path.c_str(), flags | O_CLOEXEC, 0644)) {}
  ~Descriptor() {
    if (fd_ >= 0) ::close(fd_);
  }
  Descriptor(const Descriptor&) = delete;
  int get() const { return fd_; }

 private:
  int fd_;
};

}  // namespace

Result<SpillFile> SpillFile::Open(const std::string& path, size_t element_bytes, uint64_t count,
                                  size_t buffer_bytes) {
  const Descriptor made(path, O_RDWR | O_CREAT);
  if (made.get() < 0) return CannotMake(path);
  struct stat info {};
  const auto size = static_cast<off_t>(count * element_bytes);
  if (::fstat(made.get(), &info) != 0 || info.st_size < size)
    return Fail(fmt::format("{}: is shorter than when it was left; begin anew without --resume", path));
  if (info.st_size != size && ::ftruncate(made.get(), size) != 0) return CannotWrite(path, errno);
  SpillFile file = Left(path, element_bytes, count);
  file.buffer_bytes_ = buffer_bytes;
  return file;
}

SpillFile SpillFile::Left(const std::string& path, size_t element_bytes, uint64_t count) {
  SpillFile file(path, element_bytes, kBufferBytes);
  file.count_ = count;
  return file;
}

Status SpillFile::Append(const void* element) {
  if (buffer_.size() + element_bytes_ > buffer_.capacity()) {
    QUARRY_TRY(Flush());
    buffer_.reserve(buffer_bytes_);
  }
  const auto* bytes = static_cast<const std::byte*>(element);
  buffer_.insert(buffer_.end(), bytes, bytes + element_bytes_);
  ++count_;
  return {};
}

Status SpillFile::Flush() {
  if (buffer_.empty()) return {};
  const Descriptor file(path_, O_WRONLY | O_APPEND);
  if (file.get() < 0) return CannotWrite(path_, errno);
  size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t n = ::write(file.get(), buffer_.data() + done, buffer_.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return CannotWrite(path_, n < 0 ? errno : ENOSPC);
    done += static_cast<size_t>(n);
  }
  buffer_.clear();
  return {};
}

Status SpillFile::FinishWriting() {
  QUARRY_TRY(Flush());
  buffer_ = {};
  return {};
}

Status SpillFile::Sync() {
  QUARRY_TRY(Flush());
  const Descriptor file(path_, O_WRONLY);
  if (file.get() < 0 || (::fdatasync(file.get()) != 0 && errno != EINVAL)) return CannotWrite(path_, errno);
  return {};
}

Status SpillFile::Read(uint64_t first, std::span<std::byte> out) const {
  const Descriptor file(path_, O_RDONLY);
  if (file.get() < 0) return CannotRead(path_, errno);
  size_t done = 0;
  const uint64_t offset = first * element_bytes_;
  while (done < out.size()) {
    const ssize_t n =
        ::pread(file.get(), out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return CannotRead(path_, n < 0 ? errno : EIO);
    done += static_cast<size_t>(n);
  }
  return {};
}

void SpillFile::Discard(uint64_t first, uint64_t last) const {
  const Descriptor file(path_, O_WRONLY);
  if (file.get() < 0 || last <= first) return;
  (void)!::fallocate(file.get(), FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE,
                     static_cast<off_t>(first * element_bytes_),
                     static_cast<off_t>((last - first) * element_bytes_));
}

void SpillFile::Remove() const { ::unlink(path_.c_str()); }

const std::byte* SpillReader::Next() {
  const size_t size = file_.element_bytes();
  if (at_ == filled_) {
    const uint64_t per_buffer = SpillFile::kBufferBytes / size;
    const uint64_t n = std::min<uint64_t>(per_buffer, last_ - next_);
    if (n == 0 || !status_) return nullptr;
    buffer_.resize(n * size);
    status_ = file_.Read(next_, buffer_);
    if (!status_) return nullptr;
    next_ += n;
    at_ = 0;
    filled_ = buffer_.size();
  }
  const std::byte* element = buffer_.data() + at_;
  at_ += size;
  return element;
}

}  // namespace quarry

#include "preprocess/import/byte_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <utility>

namespace quarry {

Result<ByteReader> ByteReader::Open(const std::string& path) {
  // Without O_NONBLOCK, opening a FIFO would wait for a writer that may never come.
  const int fd = open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return Fail(fmt::format("{}: cannot be opened: {}", path, ErrnoText(errno)));
  struct stat info {};
  if (fstat(fd, &info) != 0 || !S_ISREG(info.st_mode)) {
    close(fd);
    return Fail(fmt::format("{}: is not a regular file", path));
  }
  posix_fadvise(fd, 0, 0, POSIX_FADV_SEQUENTIAL);
  return ByteReader(path, fd, static_cast<uint64_t>(info.st_size));
}

ByteReader::ByteReader(std::string path, int fd, uint64_t size)
    : path_(std::move(path)), fd_(fd), size_(size), buffer_(new char[kBufferBytes]) {}

ByteReader::ByteReader(ByteReader&& other) noexcept
    : path_(std::move(other.path_)),
      fd_(std::exchange(other.fd_, -1)),
      size_(other.size_),
      buffer_(std::move(other.buffer_)),
      begin_(other.begin_),
      end_(other.end_),
      file_offset_(other.file_offset_),
      at_end_(other.at_end_),
      read_error_(other.read_error_) {}

ByteReader::~ByteReader() {
  if (fd_ >= 0) close(fd_);
}

bool ByteReader::Refill(size_t count) {
  if (at_end_) return false;
  std::memmove(buffer_.get(), buffer_.get() + begin_, available());
  end_ -= begin_;
  begin_ = 0;
  while (end_ < count) {
    const ssize_t got =
        pread(fd_, buffer_.get() + end_, kBufferBytes - end_, static_cast<off_t>(file_offset_));
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) read_error_ = errno;
    if (got <= 0) {
      at_end_ = true;
      return false;
    }
    end_ += static_cast<size_t>(got);
    file_offset_ += static_cast<uint64_t>(got);
  }
  return true;
}

bool ByteReader::Skip(uint64_t count) {
  if (count > remaining()) return false;
  if (count <= available()) {
    Consume(static_cast<size_t>(count));
    return true;
  }
  file_offset_ += count - available();
  begin_ = end_ = 0;
  return true;
}

tl::unexpected<Error> ByteReader::Truncated(const std::string& where) const {
  if (read_error_ != 0) return FailHere(fmt::format("cannot be read: {}", ErrnoText(read_error_)));
  return Fail(fmt::format("{}, byte {}: the file ends {}", path_, file_offset_, where));
}

tl::unexpected<Error> ByteReader::FailHere(const std::string& what) const {
  return Fail(fmt::format("{}, byte {}: {}", path_, offset(), what));
}

}  // namespace quarry

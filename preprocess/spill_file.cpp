#include "preprocess/spill_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <stdlib.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <utility>

namespace quarry {

Result<SpillFile> SpillFile::Create(const std::string& folder, size_t element_bytes) {
  std::string name = folder + "/quarry-spill-XXXXXX";
  const int fd = ::mkostemp(name.data(), O_CLOEXEC);
  if (fd < 0)
    return Fail(fmt::format("{}: cannot make temporary files here: {} (choose a folder with --tmp)", folder,
                            ErrnoText(errno)));
  ::unlink(name.c_str());
  return SpillFile(fd, folder, element_bytes);
}

SpillFile::SpillFile(SpillFile&& other) noexcept
    : fd_(std::exchange(other.fd_, -1)),
      folder_(std::move(other.folder_)),
      element_bytes_(other.element_bytes_),
      count_(other.count_),
      buffer_(std::move(other.buffer_)) {}

SpillFile& SpillFile::operator=(SpillFile&& other) noexcept {
  std::swap(fd_, other.fd_);
  std::swap(folder_, other.folder_);
  std::swap(element_bytes_, other.element_bytes_);
  std::swap(count_, other.count_);
  std::swap(buffer_, other.buffer_);
  return *this;
}

SpillFile::~SpillFile() {
  if (fd_ >= 0) ::close(fd_);
}

Status SpillFile::Append(const void* element) {
  if (buffer_.capacity() == 0) buffer_.reserve(kBufferBytes);
  if (buffer_.size() + element_bytes_ > kBufferBytes) QUARRY_TRY(Flush());
  const auto* bytes = static_cast<const std::byte*>(element);
  buffer_.insert(buffer_.end(), bytes, bytes + element_bytes_);
  ++count_;
  return {};
}

Status SpillFile::Flush() {
  size_t done = 0;
  while (done < buffer_.size()) {
    const ssize_t n = ::write(fd_, buffer_.data() + done, buffer_.size() - done);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0)
      return Fail(fmt::format("{}: cannot write temporary files: {} (choose another folder with --tmp)",
                              folder_, ErrnoText(n < 0 ? errno : ENOSPC)));
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

Status SpillFile::Read(uint64_t first, std::span<std::byte> out) const {
  size_t done = 0;
  const uint64_t offset = first * element_bytes_;
  while (done < out.size()) {
    const ssize_t n = ::pread(fd_, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0)
      return Fail(
          fmt::format("{}: cannot read temporary files back: {}", folder_, ErrnoText(n < 0 ? errno : EIO)));
    done += static_cast<size_t>(n);
  }
  return {};
}

const std::byte* SpillReader::Next() {
  const size_t size = file_.element_bytes();
  if (at_ == filled_) {
    const uint64_t per_buffer = SpillFile::kBufferBytes / size;
    const uint64_t n = std::min<uint64_t>(per_buffer, file_.count() - next_);
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

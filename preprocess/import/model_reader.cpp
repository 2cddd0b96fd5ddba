#include "preprocess/import/model_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

#include "common/base/output_path.h"
#include "common/base/size.h"
#include "preprocess/import/text/text_number.h"

namespace quarry {

Result<ModelReader> ModelReader::Open(const std::string& path, uint64_t unpack_limit) {
  const bool standard_input = path == "-";
  // Without O_NONBLOCK, opening a FIFO would wait for a writer that may never come.
  const int fd = standard_input ? fcntl(STDIN_FILENO, F_DUPFD_CLOEXEC, 0)
                                : open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  const std::string name = standard_input ? "standard input" : path;
  if (fd < 0) return Fail(fmt::format("{}: cannot be opened: {}", name, ErrnoText(errno)));
  ModelReader reader(name, fd);
  reader.unpack_limit_ = unpack_limit;
  struct stat info {};
  const bool regular = fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  if (!regular && !standard_input) return Fail(fmt::format("{}: is not a regular file", path));
  if (regular && !standard_input) {
    posix_fadvise(fd, 0, 0, POSIX_FADV_SEQUENTIAL);
    NoteRead(path);
    reader.can_reopen_ = true;
  }
  constexpr size_t kMagicBytes = 4;
  reader.Ensure(kMagicBytes);
  reader.decompressor_ = MakeDecompressor(reader.view());
  if (!reader.decompressor_) {
    if (regular && !standard_input) reader.size_ = static_cast<uint64_t>(info.st_size);
    return reader;
  }
  // The buffered bytes are packed.
  reader.packed_bytes_ = regular && !standard_input ? static_cast<uint64_t>(info.st_size) : reader.end_;
  reader.packed_ = std::exchange(reader.buffer_, std::make_unique<char[]>(kBufferBytes));
  reader.packed_end_ = std::exchange(reader.end_, 0);
  reader.file_offset_ = 0;
  reader.at_end_ = false;
  return reader;
}

ModelReader::ModelReader(std::string path, int fd)
    : path_(std::move(path)), fd_(fd), buffer_(new char[kBufferBytes]) {}

ModelReader::ModelReader(ModelReader&& other) noexcept
    : path_(std::move(other.path_)),
      fd_(std::exchange(other.fd_, -1)),
      on_read_(std::move(other.on_read_)),
      size_(other.size_),
      buffer_(std::move(other.buffer_)),
      begin_(other.begin_),
      end_(other.end_),
      file_offset_(other.file_offset_),
      at_end_(other.at_end_),
      can_reopen_(other.can_reopen_),
      read_error_(std::move(other.read_error_)),
      decompressor_(std::move(other.decompressor_)),
      packed_(std::move(other.packed_)),
      packed_begin_(other.packed_begin_),
      packed_end_(other.packed_end_),
      unpack_limit_(other.unpack_limit_),
      packed_bytes_(other.packed_bytes_),
      unpacked_bytes_(other.unpacked_bytes_) {}

ModelReader::~ModelReader() {
  if (fd_ >= 0) close(fd_);
}

/// Reads the file's bytes as they are; 0 at its end and on errors.
size_t ModelReader::Read(std::span<char> out) {
  for (;;) {
    const ssize_t got = read(fd_, out.data(), out.size());
    if (got > 0 && on_read_) ReportProgress();
    if (got >= 0) return static_cast<size_t>(got);
    if (errno == EINTR) continue;
    read_error_ = ErrnoText(errno);
    return 0;
  }
}

void ModelReader::OnRead(std::function<void(uint64_t done, uint64_t total)> on_read) {
  if (can_reopen_) on_read_ = std::move(on_read);
}

void ModelReader::ReportProgress() const {
  struct stat info {};
  const off_t at = lseek(fd_, 0, SEEK_CUR);
  if (at >= 0 && fstat(fd_, &info) == 0)
    on_read_(static_cast<uint64_t>(at), static_cast<uint64_t>(info.st_size));
}

/// Reads and unpacks; 0 at the end and on errors.
size_t ModelReader::ReadPacked(std::span<char> out) {
  for (;;) {
    const auto step = decompressor_->Run({packed_.get() + packed_begin_, packed_end_ - packed_begin_}, out);
    packed_begin_ += step.taken;
    read_error_ = step.error;
    if (!MayUnpack(step.given)) return 0;
    if (step.given != 0 || !step.error.empty()) return step.given;
    if (packed_begin_ != packed_end_ && step.taken != 0) continue;
    packed_begin_ = 0;
    packed_end_ = Read({packed_.get(), kBufferBytes});
    if (!can_reopen_) packed_bytes_ += packed_end_;
    if (packed_end_ != 0) continue;
    if (read_error_.empty() && !decompressor_->AtEnd()) read_error_ = "the packed file ends too early";
    return 0;
  }
}

/// False: the model has unpacked to more than its limit.
bool ModelReader::MayUnpack(size_t more) {
  unpacked_bytes_ += more;
  const uint64_t most =
      unpack_limit_ != 0 ? unpack_limit_ : std::max(kUnpackFree, kUnpackRatio * packed_bytes_);
  if (unpacked_bytes_ <= most) return true;
  const std::string why = unpack_limit_ != 0
                              ? std::string("--unpack-limit")
                              : fmt::format("more than {} times its own {}, which no model does",
                                            kUnpackRatio, FormatSize(packed_bytes_));
  read_error_ =
      fmt::format("it unpacks to more than {} ({}); --unpack-limit SIZE allows more", FormatSize(most), why);
  return false;
}

bool ModelReader::Refill(size_t count) {
  if (at_end_) return false;
  std::memmove(buffer_.get(), buffer_.get() + begin_, available());
  end_ -= begin_;
  begin_ = 0;
  while (end_ < count) {
    const std::span<char> room(buffer_.get() + end_, kBufferBytes - end_);
    const size_t got = decompressor_ ? ReadPacked(room) : Read(room);
    if (got == 0) {
      at_end_ = true;
      return false;
    }
    end_ += got;
    file_offset_ += got;
  }
  return true;
}

bool ModelReader::Skip(uint64_t count) {
  if (count > remaining()) return false;
  if (has_size() && count > available()) {
    const uint64_t beyond = count - available();
    begin_ = end_ = 0;
    if (lseek(fd_, static_cast<off_t>(beyond), SEEK_CUR) < 0) return false;
    file_offset_ += beyond;
    return true;
  }
  while (count > available()) {
    count -= available();
    Consume(available());
    if (!Ensure(1)) return false;
  }
  Consume(static_cast<size_t>(count));
  return true;
}

tl::unexpected<Error> ModelReader::Truncated(const std::string& where) const {
  if (failed()) return FailHere(fmt::format("cannot be read: {}", read_error_));
  return Fail(fmt::format("{}, byte {}: the file ends {}", path_, file_offset_, where));
}

tl::unexpected<Error> ModelReader::FailHere(const std::string& what) const {
  return Fail(fmt::format("{}, byte {}: {}", path_, offset(), what));
}

std::string_view BehindComments(ModelReader& bytes) {
  constexpr size_t kLook = 1 << 16;
  bytes.Ensure(kLook);
  std::string_view text = bytes.view().substr(0, kLook);
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  while (!text.empty() && (IsSpace(text.front()) || text.front() == '#'))
    text.remove_prefix(text.front() == '#' ? std::min(text.size(), text.find_first_of("\r\n")) : 1);
  return text;
}

}  // namespace quarry

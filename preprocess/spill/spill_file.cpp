#include "preprocess/spill/spill_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <lz4.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "common/base/descriptor.h"

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
  const auto text = fmt::format("{}: cannot read temporary files back: {}", place, ErrnoText(error));
  return error == ENOENT ? CannotResume(text) : Fail(text);
}

tl::unexpected<Error> Damaged(const std::string& path) {
  return CannotResume(fmt::format("{}: a temporary file has been changed", path));
}

/// A descriptor that is closed with the object.
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

/// Stands before each block.
struct BlockHeader {
  uint32_t elements;
  uint32_t stored;  ///< bytes that follow; equal to the elements' bytes: not packed
};

Status ReadAt(int fd, const std::string& path, uint64_t offset, std::span<char> out) {
  size_t done = 0;
  while (done < out.size()) {
    const ssize_t n = ::pread(fd, out.data() + done, out.size() - done, static_cast<off_t>(offset + done));
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return CannotRead(path, errno);
    if (n == 0) return Damaged(path);
    done += static_cast<size_t>(n);
  }
  return {};
}

Status ReadHeader(int fd, const std::string& path, uint64_t offset, BlockHeader& header) {
  return ReadAt(fd, path, offset, {reinterpret_cast<char*>(&header), sizeof header});
}

/// The bytes to be stored: in `out`, or the elements themselves.
std::span<const std::byte> Pack(std::span<const std::byte> elements, bool packs, std::span<char> out) {
  int stored = 0;
  if (packs)
    stored = LZ4_compress_default(reinterpret_cast<const char*>(elements.data()), out.data(),
                                  static_cast<int>(elements.size()), static_cast<int>(out.size()));
  const bool smaller = stored > 0 && static_cast<size_t>(stored) < elements.size();
  return smaller ? std::as_bytes(out.first(static_cast<size_t>(stored))) : elements;
}

}  // namespace

SpillFile::SpillFile(std::string path, size_t element_bytes, const Options& options)
    : content_(std::make_unique<Content>()), writer_(options.writer), block_bytes_(options.block_bytes) {
  content_->path = std::move(path);
  content_->element_bytes = element_bytes_ = element_bytes;
  content_->pack_from = options.pack_from;
}

Result<SpillFile> SpillFile::Open(const std::string& path, size_t element_bytes, uint64_t count,
                                  const Options& options) {
  const Descriptor made(path, O_RDWR | O_CREAT);
  if (made.get() < 0) return CannotMake(path);
  SpillFile file(path, element_bytes, options);
  if (!file.content_->FindBlocks(made.get(), count))
    return CannotResume(fmt::format("{}: is shorter than the earlier run left it", path));
  if (::ftruncate(made.get(), static_cast<off_t>(file.content_->bytes)) != 0) return CannotWrite(path, errno);
  file.content_->ForgetBlocks();
  file.count_ = count;
  return file;
}

SpillFile SpillFile::Left(const std::string& path, size_t element_bytes, uint64_t count) {
  SpillFile file(path, element_bytes, Options());
  file.count_ = count;
  return file;
}

Status SpillFile::Content::FindBlocks(int fd, uint64_t count) {
  struct stat info {};
  if (::fstat(fd, &info) != 0) return CannotRead(path, errno);
  blocks.clear();
  uint64_t element = 0, offset = 0;
  while (element < count) {
    BlockHeader header;
    QUARRY_TRY(ReadHeader(fd, path, offset, header));
    const uint64_t size = header.elements * element_bytes, end = offset + sizeof header + header.stored;
    if (header.elements == 0 || header.elements > count - element || size > kBlockBytes ||
        header.stored > size || end > static_cast<uint64_t>(info.st_size))
      return Damaged(path);
    blocks.push_back({element, offset});
    element += header.elements;
    offset = end;
  }
  bytes = offset;
  has_table = true;
  return {};
}

void SpillFile::Content::ForgetBlocks() {
  blocks = {};
  has_table = false;
}

void SpillFile::CopyElement(const void* element, size_t bytes, std::byte* place) {
  constexpr size_t kUsual = 48;  // a triangle without attributes: the compiler copies a known number of bytes
  if (bytes == kUsual)
    std::memcpy(place, element, kUsual);
  else
    std::memcpy(place, element, bytes);
}

Status SpillFile::MakeRoom() {
  QUARRY_TRY(Flush());
  buffer_.MakeRoom(block_bytes_ / element_bytes_ * element_bytes_);
  return {};
}

Status SpillFile::Flush() {
  if (buffer_.size == 0) return {};
  const uint64_t first = flushed();
  if (writer_)
    return writer_->Give(buffer_, [first, content = content_.get()](std::span<const std::byte> elements) {
      return content->Write(first, elements);
    });
  QUARRY_TRY(content_->Write(first, buffer_.content()));
  buffer_.size = 0;
  return {};
}

Status SpillFile::Content::Write(uint64_t first, std::span<const std::byte> elements) {
  const bool packs = bytes >= pack_from;
  const size_t room = packs ? static_cast<size_t>(LZ4_compressBound(static_cast<int>(elements.size()))) : 0;
  const auto packed = std::make_unique_for_overwrite<char[]>(room);
  const std::span<const std::byte> stored = Pack(elements, packs, {packed.get(), room});
  const BlockHeader header{static_cast<uint32_t>(elements.size() / element_bytes),
                           static_cast<uint32_t>(stored.size())};
  const Descriptor file(path, O_WRONLY | O_APPEND);
  if (file.get() < 0) return CannotWrite(path, errno);
  if (!WriteAll(file.get(), std::as_bytes(std::span(&header, 1))) || !WriteAll(file.get(), stored))
    return CannotWrite(path, errno);
  if (has_table) blocks.push_back({first, bytes});
  bytes += sizeof header + stored.size();
  return {};
}

Status SpillFile::Settle() const { return writer_ ? writer_->Wait() : Status{}; }

Status SpillFile::FinishWriting() {
  QUARRY_TRY(Flush());
  buffer_ = {};
  Status written = Settle();
  writer_ = nullptr;  // the writer may end before the file
  return written;
}

Status SpillFile::WriteOut() {
  QUARRY_TRY(Flush());
  return Settle();
}

/// The first element after a block.
uint64_t SpillFile::EndOf(size_t block) const {
  return block + 1 < content_->blocks.size() ? content_->blocks[block + 1].first : flushed();
}

uint64_t SpillFile::OffsetAfter(size_t block) const {
  return block + 1 < content_->blocks.size() ? content_->blocks[block + 1].offset : content_->bytes;
}

size_t SpillFile::BlockOf(uint64_t element) const {
  const auto after = std::ranges::upper_bound(content_->blocks, element, {}, &Block::first);
  return static_cast<size_t>(after - content_->blocks.begin()) - 1;
}

Status SpillFile::Read(uint64_t first, std::span<std::byte> out) const {
  const Descriptor file(content_->path, O_RDONLY);
  if (file.get() < 0) return CannotRead(content_->path, errno);
  if (!content_->has_table) QUARRY_TRY(content_->FindBlocks(file.get(), flushed()));
  while (!out.empty()) {
    if (first >= flushed()) return Damaged(content_->path);
    const size_t i = BlockOf(first);
    const size_t skipped = (first - content_->blocks[i].first) * content_->element_bytes;
    const std::span<std::byte> part =
        out.first(std::min(out.size(), (EndOf(i) - first) * content_->element_bytes));
    QUARRY_TRY(ReadBlock(file.get(), i, skipped, part));
    out = out.subspan(part.size());
    first = EndOf(i);
  }
  return {};
}

/// Reads the block's bytes from `skipped` on.
Status SpillFile::ReadBlock(int fd, size_t i, size_t skipped, std::span<std::byte> out) const {
  const uint64_t content = content_->blocks[i].offset + sizeof(BlockHeader);
  const size_t stored = OffsetAfter(i) - content;
  const size_t size = (EndOf(i) - content_->blocks[i].first) * content_->element_bytes;
  if (stored == size)
    return ReadAt(fd, content_->path, content + skipped, {reinterpret_cast<char*>(out.data()), out.size()});
  const auto packed = std::make_unique_for_overwrite<char[]>(stored);
  QUARRY_TRY(ReadAt(fd, content_->path, content, {packed.get(), stored}));
  // A whole block goes straight to its destination.
  const auto whole = out.size() == size ? nullptr : std::make_unique_for_overwrite<std::byte[]>(size);
  std::byte* const target = whole ? whole.get() : out.data();
  const int unpacked = LZ4_decompress_safe(packed.get(), reinterpret_cast<char*>(target),
                                           static_cast<int>(stored), static_cast<int>(size));
  if (unpacked != static_cast<int>(size)) return Damaged(content_->path);
  if (whole) std::memcpy(out.data(), whole.get() + skipped, out.size());
  return {};
}

void SpillFile::Discard(uint64_t first, uint64_t last) const {
  const Descriptor file(content_->path, O_RDWR);
  if (file.get() < 0) return;
  if (!content_->has_table && !content_->FindBlocks(file.get(), flushed())) return;
  for (size_t i = 0; i < content_->blocks.size(); ++i) {
    if (EndOf(i) <= first || EndOf(i) > last) continue;
    // All but the headers, which a later run follows.
    const uint64_t begin = content_->blocks[i].offset + sizeof(BlockHeader);
    const uint64_t end = OffsetAfter(i);
    (void)!::fallocate(file.get(), FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(begin),
                       static_cast<off_t>(end - begin));
  }
}

void SpillFile::Remove() const {
  ::unlink(content_->path.c_str());
  content_->ForgetBlocks();
}

uint64_t SpillFile::PackedBytes(std::span<const std::byte> elements) {
  std::vector<char> packed(static_cast<size_t>(LZ4_compressBound(kBlockBytes)));
  uint64_t bytes = 0;
  for (; !elements.empty(); elements = elements.subspan(std::min(elements.size(), kBlockBytes)))
    bytes += sizeof(BlockHeader) +
             Pack(elements.first(std::min(elements.size(), kBlockBytes)), true, packed).size();
  return bytes;
}

/// False: there is no further block, or it cannot be read.
bool SpillReader::Fill() {
  if (next_ >= last_ || !status_) return false;
  status_ = ReadBlock();
  return status_.has_value();
}

/// Reads the rest of a block.
Status SpillReader::ReadBlock() {
  const size_t size = file_.element_bytes();
  if (!file_.content_->has_table) {
    std::vector<std::byte> first(size);
    QUARRY_TRY(file_.Read(next_, first));  // finds the blocks
  }
  const uint64_t n = std::min(file_.EndOf(file_.BlockOf(next_)), last_) - next_;
  if (room_ < n * size) {
    room_ = n * size;
    buffer_ = std::make_unique_for_overwrite<std::byte[]>(room_);
  }
  QUARRY_TRY(file_.Read(next_, {buffer_.get(), n * size}));
  next_ += n;
  at_ = 0;
  filled_ = n * size;
  return {};
}

}  // namespace quarry

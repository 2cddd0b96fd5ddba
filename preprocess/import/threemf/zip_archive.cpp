#include "preprocess/import/threemf/zip_archive.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "common/base/size.h"
#include "preprocess/import/model_reader.h"

namespace quarry {

/// The archive's bytes, read by pread for libzip. While a directory is read, `budget` bounds the bytes.
struct ZipArchive::Source {
  int fd = -1;
  uint64_t size = 0, at = 0, budget = 0;
  bool bounded = true, over_budget = false;
  zip_error_t error{};

  Source() { zip_error_init(&error); }
  Source(const Source&) = delete;
  ~Source() {
    zip_error_fini(&error);
    if (fd >= 0) ::close(fd);
  }

  zip_int64_t Fail(int zip_code, int system_code) {
    zip_error_set(&error, zip_code, system_code);
    return -1;
  }

  zip_int64_t Read(void* data, zip_uint64_t length) {
    if (bounded && length > budget) {
      over_budget = true;
      return Fail(ZIP_ER_READ, EFBIG);
    }
    for (;;) {
      const ssize_t got = ::pread(fd, data, length, static_cast<off_t>(at));
      if (got < 0 && errno == EINTR) continue;
      if (got < 0) return Fail(ZIP_ER_READ, errno);
      at += static_cast<uint64_t>(got);
      if (bounded) budget -= static_cast<uint64_t>(got);
      return got;
    }
  }

  static zip_int64_t Call(void* user, void* data, zip_uint64_t length, zip_source_cmd_t command) {
    Source& s = *static_cast<Source*>(user);
    switch (command) {
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE,
                                              ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE,
                                              ZIP_SOURCE_SEEK, ZIP_SOURCE_TELL, -1);
      case ZIP_SOURCE_OPEN:
        s.at = 0;
        return 0;
      case ZIP_SOURCE_READ:
        return s.Read(data, length);
      case ZIP_SOURCE_STAT: {
        auto* const stat = static_cast<zip_stat_t*>(data);
        zip_stat_init(stat);
        stat->size = s.size;
        stat->valid |= ZIP_STAT_SIZE;
        return sizeof *stat;
      }
      case ZIP_SOURCE_SEEK: {
        const zip_int64_t to = zip_source_seek_compute_offset(s.at, s.size, data, length, &s.error);
        if (to < 0) return -1;
        s.at = static_cast<uint64_t>(to);
        return 0;
      }
      case ZIP_SOURCE_TELL:
        return static_cast<zip_int64_t>(s.at);
      case ZIP_SOURCE_ERROR:
        return zip_error_to_data(&s.error, data, length);
      case ZIP_SOURCE_CLOSE:
      case ZIP_SOURCE_FREE:
        return 0;
      default:
        return s.Fail(ZIP_ER_OPNOTSUPP, 0);
    }
  }
};

namespace {

/// libzip's text of an error. Ends `error`.
std::string TextOf(zip_error_t& error) {
  std::string text = zip_error_strerror(&error);
  zip_error_fini(&error);
  return text;
}

}  // namespace

Result<ZipArchive> ZipArchive::Open(const std::string& path, uint64_t unpack_limit) {
  auto source = std::make_unique<Source>();
  source->fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  struct stat info {};
  if (source->fd < 0 || ::fstat(source->fd, &info) != 0)
    return Fail(fmt::format("{}: cannot be opened: {}", path, ErrnoText(errno)));
  source->size = static_cast<uint64_t>(info.st_size);
  constexpr uint64_t kEndRecords = 2 * 65'636;  // libzip looks for the directory's end in as many bytes
  source->budget = kMostDirectoryBytes + kEndRecords;
  const uint64_t most = unpack_limit != 0
                            ? unpack_limit
                            : std::max(ModelReader::kUnpackFree, ModelReader::kUnpackRatio * source->size);
  ZipArchive archive(path, std::move(source), most, unpack_limit != 0);
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* const bytes = zip_source_function_create(Source::Call, archive.source_.get(), &error);
  if (bytes != nullptr) archive.archive_ = zip_open_from_source(bytes, ZIP_RDONLY, &error);
  if (archive.archive_ == nullptr) {
    if (bytes != nullptr) zip_source_free(bytes);
    const std::string why = TextOf(error);
    if (archive.source_->over_budget)
      return Fail(fmt::format("{}: its directory has more than {}, for parts that no model has", path,
                              FormatSize(kMostDirectoryBytes)));
    return Fail(fmt::format("{}: is not a complete zip archive, as a 3MF is ({}); get it again", path, why));
  }
  zip_error_fini(&error);
  archive.source_->bounded = false;
  return archive;
}

ZipArchive::ZipArchive(std::string path, std::unique_ptr<Source> source, uint64_t most, bool by_option)
    : path_(std::move(path)), source_(std::move(source)), most_(most), limited_by_option_(by_option) {}

ZipArchive::ZipArchive(ZipArchive&& other) noexcept
    : path_(std::move(other.path_)),
      source_(std::move(other.source_)),
      archive_(std::exchange(other.archive_, nullptr)),
      part_(std::exchange(other.part_, nullptr)),
      part_name_(std::move(other.part_name_)),
      unpacked_(other.unpacked_),
      most_(other.most_),
      limited_by_option_(other.limited_by_option_) {}

ZipArchive::~ZipArchive() {
  if (part_ != nullptr) zip_fclose(part_);
  if (archive_ != nullptr) zip_discard(archive_);
}

uint64_t ZipArchive::size() const { return source_->size; }

std::optional<uint64_t> ZipArchive::Find(const std::string& name) const {
  zip_int64_t at = zip_name_locate(archive_, name.c_str(), ZIP_FL_ENC_GUESS);
  if (at < 0) at = zip_name_locate(archive_, name.c_str(), ZIP_FL_NOCASE);
  return at < 0 ? std::nullopt : std::optional(static_cast<uint64_t>(at));
}

std::string ZipArchive::Name(uint64_t part) const {
  const char* const name = zip_get_name(archive_, part, ZIP_FL_ENC_GUESS);
  constexpr size_t kShown = 200;
  return name == nullptr ? fmt::format("part {}", part) : std::string(name).substr(0, kShown);
}

uint64_t ZipArchive::StatedSize(uint64_t part) const {
  zip_stat_t stat;
  const bool known = zip_stat_index(archive_, part, 0, &stat) == 0 && (stat.valid & ZIP_STAT_SIZE) != 0;
  return known ? stat.size : 0;
}

Status ZipArchive::OpenPart(uint64_t part) {
  if (part_ != nullptr) zip_fclose(std::exchange(part_, nullptr));
  part_name_ = Name(part);
  zip_stat_t stat;
  if (zip_stat_index(archive_, part, 0, &stat) != 0) return Damaged(zip_strerror(archive_));
  if ((stat.valid & ZIP_STAT_ENCRYPTION_METHOD) != 0 && stat.encryption_method != ZIP_EM_NONE)
    return Fail(fmt::format("{}: {} is encrypted by a password; write it without one", path_, part_name_));
  if ((stat.valid & ZIP_STAT_COMP_METHOD) != 0 && stat.comp_method != ZIP_CM_STORE &&
      stat.comp_method != ZIP_CM_DEFLATE)
    return Fail(fmt::format("{}: {} is packed by a method ({}) that 3MF does not have; pack it by deflate",
                            path_, part_name_, stat.comp_method));
  part_ = zip_fopen_index(archive_, part, 0);
  if (part_ == nullptr) return Damaged(zip_strerror(archive_));
  return {};
}

Result<size_t> ZipArchive::Read(std::span<char> out) {
  const zip_int64_t got = zip_fread(part_, out.data(), out.size());
  if (got < 0) return Damaged(zip_file_strerror(part_));
  unpacked_ += static_cast<uint64_t>(got);
  if (unpacked_ <= most_) return static_cast<size_t>(got);
  const std::string why = limited_by_option_
                              ? std::string("--unpack-limit")
                              : fmt::format("more than {} times its own {}, which no model does",
                                            ModelReader::kUnpackRatio, FormatSize(source_->size));
  return Fail(fmt::format("{}: it unpacks to more than {} ({}); --unpack-limit SIZE allows more", path_,
                          FormatSize(most_), why));
}

tl::unexpected<Error> ZipArchive::Damaged(const std::string& why) const {
  return Fail(fmt::format("{}: {} cannot be unpacked ({}): the archive is damaged, get it again", path_,
                          part_name_, why));
}

}  // namespace quarry

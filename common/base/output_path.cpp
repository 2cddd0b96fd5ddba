#include "common/base/output_path.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <filesystem>
#include <initializer_list>
#include <mutex>
#include <optional>
#include <utility>

#include "common/base/bytes.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

constexpr int kMostLinks = 40;        // the kernel's own limit
constexpr size_t kStartBytes = 4096;  // bytes; enough to find a JSON file's first member

std::string_view WithoutBlanks(std::string_view text) {
  const size_t first = text.find_first_not_of(" \t\r\n");
  return text.substr(std::min(first, text.size()));
}

/// Whether `start` begins a JSON object whose first member is one of `first_members`.
bool BeginsObject(std::string_view start, std::initializer_list<std::string_view> first_members) {
  start = WithoutBlanks(start);
  if (!start.starts_with('{')) return false;
  start = WithoutBlanks(start.substr(1));
  return std::ranges::any_of(first_members, [&](std::string_view member) {
    return start.starts_with('"') && start.substr(1).starts_with(member) &&
           start.substr(1 + member.size()).starts_with('"');
  });
}

bool IsPng(std::string_view start) { return start.starts_with("\x89PNG\r\n\x1A\n"); }
bool IsExr(std::string_view start) { return start.starts_with("\x76\x2F\x31\x01"); }
/// Statistics of quarry-preprocess, of its --plan, or of quarry render.
bool IsStatistics(std::string_view start) {
  return BeginsObject(start, {"scene_id", "input_triangles", "render_wall_s"});
}
bool IsView(std::string_view start) { return BeginsObject(start, {"camera"}); }
bool IsTrace(std::string_view start) { return BeginsObject(start, {"frame"}); }
/// Figures of benchmarks: any JSON except files that programs read as input.
bool IsFigures(std::string_view start) {
  if (BeginsObject(start, {"frames", "lights", "materials", "camera"})) return false;
  const std::string_view text = WithoutBlanks(start);
  return (text.starts_with('{') || text.starts_with('[') || text.starts_with("null")) &&
         text.find("\"asset\"") == std::string_view::npos;
}

std::string FolderOf(const std::string& path) {
  const size_t slash = path.rfind('/');
  return slash == std::string::npos ? "" : path.substr(0, slash + 1);
}

/// Follows a chain of symbolic links to its end, which need not exist. Links in /proc (/dev/stdout leads
/// there) name open files, which are written to and not replaced.
Result<OutputPlace> Followed(std::string path) {
  for (int i = 0; i < kMostLinks; ++i) {
    char target[PATH_MAX];
    const ssize_t size = ::readlink(path.c_str(), target, sizeof target);
    if (size < 0) return OutputPlace{std::move(path), false};
    if (path.starts_with("/proc/") || path.starts_with("/dev/fd/")) return OutputPlace{std::move(path), true};
    const std::string to(target, static_cast<size_t>(size));
    path = to.starts_with('/') ? to : FolderOf(path) + to;
  }
  return BadUsage(fmt::format("{}: its symbolic links lead in a circle; name another file", path));
}

/// The first bytes of an existing regular file. Other kinds of file are not examined.
struct Existing {
  bool regular = false, readable = false;
  uint64_t size = 0;
  std::string start;
};
Existing Look(const std::string& path) {
  Existing found;
  struct stat info {};
  found.regular = ::stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode);
  if (!found.regular) return found;
  found.size = static_cast<uint64_t>(info.st_size);
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) return found;
  found.start.resize(kStartBytes);
  const ssize_t n = ::read(fd, found.start.data(), found.start.size());
  ::close(fd);
  found.readable = n >= 0;
  found.start.resize(n > 0 ? static_cast<size_t>(n) : 0);
  return found;
}

/// The canonical path of a file that need not exist.
std::string OneSpelling(const std::string& path) {
  std::error_code error;
  const fs::path whole = fs::weakly_canonical(path, error);
  return error ? path : whole.string();
}

/// The facts that identify a file, also against a later file with the inode of a deleted one.
struct FileIdentity {
  uint64_t device = 0, inode = 0;
  int64_t born_s = 0, born_ns = 0;  ///< 0 where the file system has none

  bool operator==(const FileIdentity&) const = default;
};

/// Of the file at `path`, links followed; none if there is no file.
std::optional<FileIdentity> IdentityOf(const std::string& path) {
  struct statx info {};
  if (::statx(AT_FDCWD, path.c_str(), 0, STATX_INO | STATX_BTIME, &info) != 0) return std::nullopt;
  FileIdentity identity{uint64_t{info.stx_dev_major} << 32 | info.stx_dev_minor, info.stx_ino, 0, 0};
  if (info.stx_mask & STATX_BTIME) {
    identity.born_s = info.stx_btime.tv_sec;
    identity.born_ns = info.stx_btime.tv_nsec;
  }
  return identity;
}

/// A file that an output will replace, and whether this run has read it.
struct Claim {
  FileIdentity file;
  bool read;
};
std::mutex claims_mutex;
std::vector<Claim> claims;

/// The claim of the file at `path`, or null.
Claim* FindClaim(const std::string& path) {
  const auto identity = IdentityOf(path);
  if (!identity) return nullptr;
  const auto found = std::ranges::find(claims, *identity, &Claim::file);
  return found == claims.end() ? nullptr : &*found;
}

void ClaimFile(const std::string& path) {
  const std::lock_guard lock(claims_mutex);
  const auto identity = IdentityOf(path);
  if (identity && !FindClaim(path)) claims.push_back({*identity, false});
}

}  // namespace

void NoteRead(const std::string& path) {
  const std::lock_guard lock(claims_mutex);
  if (claims.empty()) return;
  if (Claim* const claim = FindClaim(path)) claim->read = true;
}

Status CheckNotRead(const std::string& path) {
  const std::lock_guard lock(claims_mutex);
  if (claims.empty()) return {};
  const Claim* const claim = FindClaim(path);
  if (!claim || !claim->read) return {};
  return BadUsage(fmt::format("{}: is an input of this run and would be replaced; name another file", path));
}

const OutputKind kPngOutput{"a PNG image", IsPng, true};
const OutputKind kExrOutput{"an EXR image", IsExr, true};
const OutputKind kStatisticsOutput{"a statistics file of Quarry", IsStatistics, true};
const OutputKind kViewOutput{"a view file of Quarry", IsView, true};
const OutputKind kTraceOutput{"a tile trace of Quarry", IsTrace, true};
const OutputKind kFiguresOutput{"a JSON file of figures", IsFigures, true};

Result<OutputPlace> PlaceOf(const std::string& path) {
  if (path.empty()) return BadUsage("an output has no name; give one");
  struct stat info {};
  if (::stat(path.c_str(), &info) != 0) {
    if (errno == ELOOP)
      return BadUsage(fmt::format("{}: its symbolic links lead in a circle; name another file", path));
    return Followed(path);  // nothing there, or a dangling link; writing reports any other error
  }
  if (S_ISREG(info.st_mode)) return Followed(path);
  if (S_ISCHR(info.st_mode) || S_ISFIFO(info.st_mode)) return OutputPlace{path, true};
  if (S_ISDIR(info.st_mode))
    return BadUsage(fmt::format("{}: is a folder, and the output is a file; name a file in it", path));
  return BadUsage(fmt::format("{}: is a disk or a socket, and the output is a file; name another", path));
}

std::string BesidePath(const std::string& path, std::string_view suffix) {
  const std::string folder = FolderOf(path), name = path.substr(folder.size());
  const long limit = ::pathconf(folder.empty() ? "." : folder.c_str(), _PC_NAME_MAX);
  const size_t most = limit > 0 ? static_cast<size_t>(limit) : NAME_MAX;
  if (name.size() + suffix.size() <= most) return path + std::string(suffix);
  const std::string hash = fmt::format("-{:016x}", Checksum(AsBytes(name)));
  size_t kept = most - std::min(most, suffix.size() + hash.size());
  while (kept > 0 && (name[kept] & 0xC0) == 0x80) --kept;  // not in the middle of a UTF-8 letter
  return folder + name.substr(0, kept) + hash + std::string(suffix);
}

void OutputGuard::AddInput(const std::string& path) {
  struct stat info {};
  if (path.empty() || ::stat(path.c_str(), &info) != 0) return;
  inputs_.push_back({path, info.st_dev, info.st_ino});
}

Result<OutputPlace> OutputGuard::Take(const std::string& path, const OutputKind& kind) {
  QUARRY_ASSIGN(OutputPlace place, PlaceOf(path));
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode))
    for (const Known& input : inputs_)
      if (input.device == info.st_dev && input.inode == info.st_ino)
        return BadUsage(fmt::format(
            "{}: is an input of this run ({}) and would be replaced; name another file", path, input.path));
  if (place.stream) {
    if (kind.streams) return place;
    return BadUsage(
        fmt::format("{}: is a device or FIFO, and {} needs a regular file; name one", path, kind.name));
  }
  std::string spelling = OneSpelling(place.path);
  for (const auto& [other, other_spelling] : outputs_)
    if (other_spelling == spelling)
      return BadUsage(
          fmt::format("{}: is written twice in this run (as {}); name another file", path, other));
  outputs_.emplace_back(path, std::move(spelling));
  const Existing found = Look(place.path);
  const bool ours = !found.regular || found.size == 0 || (found.readable && kind.fits(found.start));
  if (ours || force_ == Force::kYes) {
    if (found.regular) ClaimFile(place.path);
    return place;
  }
  return BadUsage(fmt::format("{}: exists and is not {}, so it is not replaced; name another file{}", path,
                              kind.name,
                              force_ == Force::kNo ? ", or give --force" : ", or remove it first"));
}

Status OutputGuard::TakeFolder(const std::string& path) {
  struct stat info {};
  if (path.empty()) return BadUsage("a folder to write to has no name; give one");
  if (::stat(path.c_str(), &info) == 0 && !S_ISDIR(info.st_mode))
    return BadUsage(fmt::format("{}: exists and is not a folder; name another", path));
  return {};
}

}  // namespace quarry

#include "common/remote/secret_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>

#include "common/base/descriptor.h"

namespace quarry {
namespace {

// Limit of a file with headers or credentials in bytes; real files are far shorter.
constexpr size_t kMaxFileBytes = 64 << 10;

/// A regular file, open for reading.
class RegularFile {
 public:
  explicit RegularFile(const std::string& path)
      : file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY)) {
    if (!file_)
      fault_ = fmt::format("{}: cannot open: {}", path, ErrnoText(errno));
    else if (::fstat(file_.get(), &info_) != 0 || !S_ISREG(info_.st_mode))
      fault_ = fmt::format("{}: is not a plain file", path);
  }

  const std::string& fault() const { return fault_; }
  const struct stat& info() const { return info_; }

  Result<std::string> Read(const std::string& path) const {
    std::string text(kMaxFileBytes + 1, '\0');
    size_t size = 0;
    while (size < text.size()) {
      const ssize_t n = ::read(file_.get(), text.data() + size, text.size() - size);
      if (n < 0 && errno == EINTR) continue;
      if (n < 0) return BadUsage(fmt::format("{}: cannot read: {}", path, ErrnoText(errno)));
      if (n == 0) break;
      size += static_cast<size_t>(n);
    }
    if (size > kMaxFileBytes) return BadUsage(fmt::format("{}: longer than 64 KiB", path));
    text.resize(size);
    return text;
  }

 private:
  OwnedDescriptor file_;
  struct stat info_ {};
  std::string fault_;
};

}  // namespace

Result<std::string> ReadSecretFile(const std::string& path) {
  const RegularFile file(path);
  if (!file.fault().empty()) return BadUsage(file.fault());
  if ((file.info().st_mode & 077) != 0)
    return BadUsage(fmt::format("{}: users other than its owner may read this secret; chmod 600 it", path));
  if (StrangerOwns(file.info())) return BadUsage(StrangerSentence(path, file.info()));
  return file.Read(path);
}

Result<std::string> ReadPlainFile(const std::string& path) {
  const RegularFile file(path);
  if (!file.fault().empty()) return BadUsage(file.fault());
  return file.Read(path);
}

Status CheckRegular(const std::string& path) {
  const RegularFile file(path);
  return file.fault().empty() ? Status() : BadUsage(file.fault());
}

}  // namespace quarry

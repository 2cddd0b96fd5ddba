#include "deploy/command/view_token.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>

#include "common/base/bytes.h"
#include "common/remote/open_store.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

/// Permissions of group and others.
constexpr mode_t kOthers = 077;

Result<std::string> StateFolder() {
  const auto variable = [](const char* name) {
    const char* value = std::getenv(name);
    return std::string(value ? value : "");
  };
  // As the XDG base directory specification has it: a path that is not absolute is ignored.
  if (const std::string state = variable("XDG_STATE_HOME"); state.starts_with("/")) return state + "/quarry";
  if (const std::string home = variable("HOME"); home.starts_with("/")) return home + "/.local/state/quarry";
  return Fail("neither XDG_STATE_HOME nor HOME names a folder");
}

/// Makes a folder of this user's own. Errors: it cannot be made, or is another's or open to others.
Status TakeOwnFolder(const std::string& folder) {
  std::error_code error;
  fs::create_directories(fs::path(folder).parent_path(), error);
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    return Fail(fmt::format("{}: cannot make this folder", folder));
  struct stat facts {};
  if (::lstat(folder.c_str(), &facts) == 0 && S_ISDIR(facts.st_mode) && facts.st_uid == ::geteuid() &&
      (facts.st_mode & kOthers) == 0)
    return {};
  return Fail(fmt::format("{}: is not a folder that this user alone may open (chmod 700)", folder));
}

/// One name for each store and port, whatever folder a command is given in.
std::string NameFor(const std::string& scene, const std::string& address) {
  std::error_code error;
  const std::string place = IsRemote(scene) ? scene : fs::weakly_canonical(scene, error).string();
  const std::string text = place + "\n" + address.substr(address.rfind(':') + 1);
  return fmt::format("{:016x}", Checksum(AsBytes(text)));
}

}  // namespace

Status WriteNewToken(const std::string& path) {
  std::array<unsigned char, 32> random{};
  if (::getrandom(random.data(), random.size(), 0) != static_cast<ssize_t>(random.size()))
    return Fail("the system gives no random bytes");
  std::string text;
  for (const unsigned char byte : random) text += fmt::format("{:02x}", byte);
  const int fd = ::open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600);
  const bool written = fd >= 0 && ::write(fd, text.data(), text.size()) == static_cast<ssize_t>(text.size());
  if (fd >= 0) ::close(fd);
  if (written) return {};
  if (fd >= 0) ::unlink(path.c_str());
  return Fail(fmt::format("{}: cannot be written", path));
}

Result<std::string> KeptTokenFile(const std::string& scene, const std::string& address) {
  QUARRY_ASSIGN(const std::string state, StateFolder());
  const std::string folder = state + "/tokens";
  QUARRY_TRY(TakeOwnFolder(folder));
  const std::string path = folder + "/" + NameFor(scene, address);
  struct stat facts {};
  if (::lstat(path.c_str(), &facts) != 0) {
    QUARRY_TRY(WriteNewToken(path));
    return path;
  }
  constexpr off_t kTokenLetters = 64;
  if (S_ISREG(facts.st_mode) && facts.st_uid == ::geteuid() && (facts.st_mode & kOthers) == 0 &&
      facts.st_size == kTokenLetters)
    return path;
  return Fail(fmt::format("{}: is not a token of this user's alone; remove it", path));
}

}  // namespace quarry

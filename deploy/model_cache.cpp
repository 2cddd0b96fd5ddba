#include "deploy/model_cache.h"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>

#include "common/base/file.h"
#include "common/base/output_path.h"
#include "common/voxel/store_format.h"
#include "deploy/cluster.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;

std::string CacheFolder() {
  if (const char* folder = std::getenv("QUARRY_CACHE_DIR")) return folder;
  if (const char* folder = std::getenv("XDG_CACHE_HOME")) return std::string(folder) + "/quarry";
  if (const char* home = std::getenv("HOME")) return std::string(home) + "/.cache/quarry";
  return "/tmp/quarry-cache";
}

/// The store's name says what it was made from: a changed model, or another format version, has another name.
std::string CachedName(const std::string& model, const struct stat& info) {
  std::error_code error;
  const std::string absolute = fs::absolute(model, error).string();
  const std::string key = fmt::format("{}|{}|{}.{}|{}", absolute, info.st_size, info.st_mtim.tv_sec,
                                      info.st_mtim.tv_nsec, kStoreVersion);
  return fmt::format("{}-{:016x}.quarry", fs::path(model).stem().string(), Checksum(AsBytes(key)));
}

}  // namespace

Result<std::string> StoreFor(const std::string& scene, bool quiet) {
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(scene));
  Bytes start(std::min<uint64_t>(file.size(), kStoreMagic.size()));
  QUARRY_TRY(file.ReadAt(0, start));
  if (AsText(start) == kStoreMagic || fs::path(scene).extension() == ".quarry") return scene;

  struct stat info {};
  if (::stat(scene.c_str(), &info) != 0)
    return Fail(fmt::format("{}: cannot examine: {}", scene, ErrnoText(errno)));
  const std::string folder = CacheFolder();
  std::error_code error;
  QUARRY_TRY(OutputGuard::TakeFolder(folder));
  fs::create_directories(folder, error);
  if (error) return Fail(fmt::format("{}: cannot make this folder: {}", folder, error.message()));
  const std::string store = folder + "/" + CachedName(scene, info);
  if (fs::exists(store, error)) return store;
  // Under a name of our own first: another `quarry render` may be at the same model.
  const std::string own = fmt::format("{}.{}", store, ::getpid());
  std::vector<std::string> arguments{scene, "-o", own};
  if (quiet) arguments.push_back("--quiet");
  QUARRY_ASSIGN(const int status, RunSibling("quarry-preprocess", arguments));
  if (status != 0)
    return tl::unexpected<Error>(Error{fmt::format("{}: could not be preprocessed", scene), status});
  fs::rename(own, store, error);
  if (error) return Fail(fmt::format("{}: cannot be renamed: {}", own, error.message()));
  return store;
}

}  // namespace quarry

#include "deploy/command/model_cache.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>

#include "common/base/cleanup.h"
#include "common/base/file.h"
#include "common/base/file_lock.h"
#include "common/base/json_file.h"
#include "common/base/log.h"
#include "common/base/output_path.h"
#include "common/base/size.h"
#include "common/base/version.h"
#include "common/voxel/store_header.h"
#include "common/voxel/store_reader.h"
#include "deploy/command/cluster.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr char kStoreExtension[] = ".quarry";
constexpr const char* kLimitFile = "limit";
constexpr size_t kMostStemBytes = 200;

std::optional<std::string> Variable(const char* name) {
  const char* const value = std::getenv(name);
  return value && *value ? std::optional<std::string>(value) : std::nullopt;
}

/// The name of a model's store. It depends on the model, its import options, the importer and the format, so
/// that none of them can use another's store.
std::string KeptName(const std::string& model, const ImportArguments& import) {
  std::error_code error;
  const std::string absolute = fs::absolute(model, error).lexically_normal().string();
  const std::string key = fmt::format("{}|{}|{}|{}|{}", absolute, kStoreVersion, kImportVersion, kVersion,
                                      fmt::join(Flags(import), " "));
  // Room for ".work", ".json" and the like beside the longest name that a folder takes.
  std::string stem = fs::path(model).stem().string();
  for (size_t most = kMostStemBytes; stem.size() > most && most > 0; --most)
    if ((stem[most] & 0xC0) != 0x80) stem.resize(most);  // not in the middle of a UTF-8 letter
  return fmt::format("{}-{:016x}{}", stem, Checksum(AsBytes(key)), kStoreExtension);
}

/// Whether a file's name has the form of KeptName().
bool IsKeptName(const std::string& name) {
  constexpr size_t kHash = 16, kEnd = kHash + std::string_view(kStoreExtension).size();
  return name.ends_with(kStoreExtension) && name.size() > kEnd && name[name.size() - kEnd - 1] == '-' &&
         name.find_first_not_of("0123456789abcdef", name.size() - kEnd) == name.size() - kEnd + kHash;
}

/// The record that the preprocessor writes beside a store: the files that the store is made from.
constexpr char kRecordEnd[] = ".json";
std::string RecordOf(const std::string& store) { return store + kRecordEnd; }

int64_t Nanoseconds(const timespec& time) { return int64_t{time.tv_sec} * 1000000000 + time.tv_nsec; }

/// Whether a file is unchanged since the record was made.
bool IsAsRecorded(const Json& input) {
  const auto file = input.find("file"), there = input.find("there");
  if (file == input.end() || !file->is_string() || there == input.end() || !there->is_boolean()) return false;
  struct stat info {};
  if (::stat(file->get_ref<const std::string&>().c_str(), &info) != 0) return !there->get<bool>();
  const auto is = [&input](const char* key, auto value) {
    const auto found = input.find(key);
    return found != input.end() && *found == value;
  };
  // The second time cannot be set: it shows that a file was changed and given its old time.
  return there->get<bool>() && is("bytes", static_cast<uint64_t>(info.st_size)) &&
         is("changed_ns", Nanoseconds(info.st_mtim)) && is("status_changed_ns", Nanoseconds(info.st_ctim));
}

/// A store's record; none where there is no file as the preprocessor writes it.
std::optional<Json> ReadRecord(const std::string& store) {
  auto record = ReadJsonFile<Json>(RecordOf(store));
  if (!record || !record->is_object()) return std::nullopt;
  const auto models = record->find("models"), inputs = record->find("inputs");
  if (models == record->end() || !models->is_array() || models->empty() || !models->front().is_string() ||
      inputs == record->end() || !inputs->is_array())
    return std::nullopt;
  return std::move(*record);
}

/// The record of a store that is being made. It says whose store this is.
Status WriteFirstRecord(const std::string& store, const std::string& model) {
  std::error_code error;
  const Json record = {{"models", {fs::absolute(model, error).lexically_normal().string()}},
                       {"inputs", Json::array()}};
  return WriteFileAtomically(RecordOf(store),
                             AsBytes(record.dump(2, ' ', false, Json::error_handler_t::replace) + "\n"));
}

bool IsRegular(const std::string& path) {
  struct stat info {};
  return ::lstat(path.c_str(), &info) == 0 && S_ISREG(info.st_mode);
}

/// Whether a store has been written to since its last use: its record gets the time of each use.
bool WasTouched(const std::string& store) {
  struct stat info {
  }, record{};
  return ::stat(store.c_str(), &info) != 0 || ::stat(RecordOf(store).c_str(), &record) != 0 ||
         Nanoseconds(info.st_mtim) > Nanoseconds(record.st_mtim);
}

/// Whether a store's catalog is sound, and, where there is reason for doubt, every byte of it.
bool IsSound(const std::string& store) {
  const auto reader = StoreReader::Open(store);
  return reader && (!WasTouched(store) || reader->Verify([](uint64_t, uint64_t) {}));
}

/// Whether the store exists and all files that it is made from are unchanged.
bool IsCurrent(const std::string& store) {
  if (!IsRegular(store) || !IsRegular(RecordOf(store))) return false;
  const auto record = ReadRecord(store);
  const auto inputs = record ? record->find("inputs") : Json::const_iterator();
  return record && !inputs->empty() && std::ranges::all_of(*inputs, [](const Json& input) {
           return input.is_object() && IsAsRecorded(input);
         });
}

/// Makes the folder of kept stores, for this user alone. Errors: it belongs to somebody else, or others may
/// write to it: they could put their stores, or links, in the place of this user's.
Status PrepareFolder(const std::string& folder) {
  constexpr const char* kAdvice = "name another by QUARRY_CACHE_DIR";
  std::error_code error;
  QUARRY_TRY(OutputGuard::TakeFolder(folder));
  const fs::path parent = fs::path(folder).parent_path();
  if (!parent.empty()) fs::create_directories(parent, error);
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
    return Fail(
        fmt::format("{}: stores of models cannot be kept there: {}; {}", folder, ErrnoText(errno), kAdvice));
  struct stat info {};
  if (::lstat(folder.c_str(), &info) == 0 && S_ISLNK(info.st_mode) && info.st_uid != ::geteuid())
    return Fail(fmt::format("{}: is another user's link; {}", folder, kAdvice));
  if (::stat(folder.c_str(), &info) != 0 || !S_ISDIR(info.st_mode))
    return Fail(fmt::format("{}: is no folder; {}", folder, kAdvice));
  if (info.st_uid != ::geteuid())
    return Fail(fmt::format("{}: belongs to another user, whose stores would be shown; {}", folder, kAdvice));
  if ((info.st_mode & (S_IWGRP | S_IWOTH)) != 0)
    return Fail(fmt::format("{}: other users may write there; chmod go-w it, or {}", folder, kAdvice));
  return {};
}

/// Waits while another process makes this store.
Result<FileLock> AwaitTurn(const std::string& store, const std::string& model, bool quiet) {
  for (bool reported = quiet;; reported = true) {
    QUARRY_ASSIGN(std::optional<FileLock> lock, FileLock::TryTake(store + ".turn"));
    if (lock) return std::move(*lock);
    if (!reported) Log(fmt::format("{}: another program is preprocessing it; waiting", model));
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

/// Gives a copy of a model the model's permissions.
void SetModeOf(const std::string& model, const std::string& copy) {
  struct stat info {};
  if (::stat(model.c_str(), &info) == 0)
    (void)::chmod(copy.c_str(), (info.st_mode & 0666) | S_IRUSR | S_IWUSR);
}

Status Make(const std::string& model, const ImportArguments& import, const std::string& store, bool quiet) {
  std::error_code error;
  for (const std::string& file : {store, RecordOf(store)})
    if (fs::is_symlink(file, error)) fs::remove(file, error);
  std::vector<std::string> arguments{
      model, "-o", store, "--stats", RecordOf(store), "--force", "--resume-if-fit"};
  if (quiet) arguments.push_back("--quiet");
  const auto flags = Flags(import);
  arguments.insert(arguments.end(), flags.begin(), flags.end());
  const mode_t before = ::umask(0077);                     // until it has the model's
  const Status recorded = WriteFirstRecord(store, model);  // in place of the previous store's
  const auto ran =
      recorded ? RunSibling("quarry-preprocess", arguments) : tl::unexpected<Error>(recorded.error());
  ::umask(before);
  QUARRY_ASSIGN(const int status, ran);
  // The preprocessor has reported any error itself, except when a signal ended it.
  const bool reported = status == 1 || status == 2;
  if (status != 0 && !fs::exists(store + ".work", error)) fs::remove(RecordOf(store), error);
  if (status != 0)
    return tl::unexpected<Error>(
        reported ? Error{"", KindOfExit(status)}
                 : Error{fmt::format("{}: quarry-preprocess was ended by the system", model)});
  SetModeOf(model, store);
  QUARRY_ASSIGN(const uint64_t limit, KeptStoresLimit());
  if (limit == 0) return {};
  // Never removes the store just made, however large it is.
  const uint64_t own = fs::file_size(store, error) + fs::file_size(RecordOf(store), error);
  return ShrinkKeptStores(std::max(limit, own)).map([](auto&&) {});
}

uint64_t BytesIn(const fs::path& folder) {
  uint64_t bytes = 0;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const uint64_t size = entry.file_size(error);
    if (!error) bytes += size;
  }
  return bytes;
}

/// Removes a store and the files beside it. Returns: false when the store is being made.
Result<bool> RemoveKept(const KeptStore& kept) {
  QUARRY_ASSIGN(const std::optional<FileLock> turn, FileLock::TryTake(kept.path + ".turn"));
  if (!turn) return false;
  std::error_code error;
  fs::remove(RecordOf(kept.path), error);
  fs::remove(kept.path, error);
  if (!error) fs::remove_all(kept.path + ".work", error);
  if (error) return Fail(fmt::format("{}: cannot be removed: {}", kept.path, error.message()));
  return true;
}

}  // namespace

std::string CacheFolder() {
  if (const auto folder = Variable("QUARRY_CACHE_DIR")) return *folder;
  if (const auto folder = Variable("XDG_CACHE_HOME")) return *folder + "/quarry";
  if (const auto home = Variable("HOME")) return *home + "/.cache/quarry";
  return fmt::format("/tmp/quarry-cache-{}", ::geteuid());
}

Result<std::string> StoreFor(const std::string& scene, const ImportArguments& import, bool quiet) {
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(scene));
  Bytes start(std::min<uint64_t>(file.size(), kStoreMagic.size()));
  QUARRY_TRY(file.ReadAt(0, start));
  if (AsText(start) == kStoreMagic || fs::path(scene).extension() == kStoreExtension) {
    QUARRY_TRY(RefuseImportOptions(import, scene + " is a store"));
    return scene;
  }
  const std::string folder = CacheFolder();
  QUARRY_TRY(PrepareFolder(folder));
  const std::string store = folder + "/" + KeptName(scene, import);
  QUARRY_ASSIGN(const FileLock turn, AwaitTurn(store, scene, quiet));
  const bool current = IsCurrent(store), sound = current && IsSound(store);
  if (current && !sound && !quiet)
    Log(fmt::format("{}: the store kept of it, {}, is damaged, and is made anew", scene, store));
  if (sound) {
    if (!quiet) Log(fmt::format("{}: using the store kept of it, {} (see quarry cache)", scene, store));
    ::utimensat(AT_FDCWD, RecordOf(store).c_str(), nullptr, 0);  // the time of last use
    return store;
  }
  PrintOnSignal("nothing was rendered");
  if (!quiet && ::isatty(2) != 0 && !std::getenv("QUARRY_PROGRESS_FILE"))
    Log(fmt::format("{}: is preprocessed first; quarry view shows a preview of a model meanwhile", scene));
  QUARRY_TRY(Make(scene, import, store, quiet));
  PrintOnSignal(kKeptOnSignal);
  return store;
}

Result<std::string> EnvironmentStoreFor(const std::string& place, bool quiet) {
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(place));
  Bytes start(std::min<uint64_t>(file.size(), kStoreMagic.size()));
  QUARRY_TRY(file.ReadAt(0, start));
  std::string extension = fs::path(place).extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) { return std::tolower(c); });
  if (AsText(start) != kStoreMagic && extension != ".hdr" && extension != ".exr")
    return BadUsage(
        fmt::format("--environment {}: is neither an image of radiance, .hdr or .exr, nor its store", place));
  QUARRY_ASSIGN(std::string store, StoreFor(place, {}, quiet));
  QUARRY_ASSIGN(const StoreReader reader, StoreReader::Open(store));
  if (!reader.catalog().sky)
    return BadUsage(fmt::format("--environment {}: is a scene's store, not that of an image", place));
  return store;
}

Result<bool> DiscardDamaged(const std::string& model, const ImportArguments& import) {
  const std::string store = CacheFolder() + "/" + KeptName(model, import);
  const auto record = ReadRecord(store);
  if (!record || record->at("inputs").empty()) return false;  // none was finished
  const auto reader = StoreReader::Open(store);
  if (reader && reader->Verify([](uint64_t, uint64_t) {})) return false;
  return RemoveKept({store});
}

std::vector<std::string> FilesOfKept(const std::string& store) {
  std::vector<std::string> files;
  const auto record = ReadRecord(store);
  if (!record) return files;
  for (const Json& input : (*record)["inputs"])
    if (input.is_object() && input.contains("file") && input["file"].is_string())
      files.push_back(input["file"].get<std::string>());
  return files;
}

Result<std::vector<KeptStore>> ListKeptStores() {
  std::vector<KeptStore> kept;
  const std::string folder = CacheFolder();
  std::error_code error;
  if (!fs::exists(folder, error)) return kept;
  std::vector<std::string> stores;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    std::string path = entry.path().string();
    if (path.ends_with(kRecordEnd))
      path.resize(path.size() - std::string_view(kRecordEnd).size());
    else
      continue;
    if (IsKeptName(fs::path(path).filename().string())) stores.push_back(path);
  }
  if (error) return Fail(fmt::format("{}: cannot be listed: {}", folder, error.message()));
  for (const std::string& path : stores) {
    const auto record = ReadRecord(path);
    if (!record) continue;  // not of ours
    KeptStore store{path, record->at("models").front().get<std::string>()};
    struct stat info {};
    store.finished = ::stat(path.c_str(), &info) == 0;
    for (const std::string& file : {path, RecordOf(path)})
      if (::stat(file.c_str(), &info) == 0) {
        store.bytes += static_cast<uint64_t>(info.st_size);
        store.used_ns = std::max(store.used_ns, Nanoseconds(info.st_mtim));
      }
    store.bytes += BytesIn(path + ".work");
    if (!store.finished && ::stat((path + ".work").c_str(), &info) == 0)
      store.used_ns = Nanoseconds(info.st_mtim);
    kept.push_back(std::move(store));
  }
  std::ranges::stable_sort(kept, {}, &KeptStore::used_ns);
  return kept;
}

Result<std::vector<KeptStore>> ShrinkKeptStores(uint64_t most) {
  QUARRY_ASSIGN(const std::vector<KeptStore> kept, ListKeptStores());
  uint64_t bytes = 0;
  for (const KeptStore& store : kept) bytes += store.bytes;
  std::vector<KeptStore> gone;
  for (const KeptStore& store : kept) {
    if (bytes <= most) break;
    QUARRY_ASSIGN(const bool removed, RemoveKept(store));
    if (!removed) continue;
    bytes -= store.bytes;
    gone.push_back(store);
  }
  return gone;
}

Result<uint64_t> KeptStoresLimit() {
  const std::string path = CacheFolder() + "/" + kLimitFile;
  std::error_code error;
  if (!fs::exists(path, error)) return uint64_t{0};
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(path));
  Bytes text(std::min<uint64_t>(file.size(), 64));
  QUARRY_TRY(file.ReadAt(0, text));
  std::string_view number = AsText(text);
  while (number.ends_with('\n')) number.remove_suffix(1);
  const auto limit = ParseSize(number, path);
  if (!limit)
    return Fail(fmt::format("{}: holds no size; quarry cache limit SIZE (or none) sets it anew", path));
  return *limit;
}

Status SetKeptStoresLimit(uint64_t bytes) {
  const std::string folder = CacheFolder();
  QUARRY_TRY(PrepareFolder(folder));
  return WriteFileAtomically(folder + "/" + kLimitFile, AsBytes(fmt::format("{}\n", bytes)));
}

}  // namespace quarry

#include "deploy/model_cache.h"

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
#include "common/base/output_path.h"
#include "common/base/size.h"
#include "common/base/version.h"
#include "common/voxel/store_format.h"
#include "deploy/cluster.h"

namespace quarry {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr const char* kStoreExtension = ".quarry";
constexpr const char* kLimitFile = "limit";

std::optional<std::string> Variable(const char* name) {
  const char* const value = std::getenv(name);
  return value && *value ? std::optional<std::string>(value) : std::nullopt;
}

/// The name of a model's store. It depends on the model, the importer and the format, so that none of them
/// can use another's store.
std::string KeptName(const std::string& model) {
  std::error_code error;
  const std::string absolute = fs::absolute(model, error).lexically_normal().string();
  const std::string key = fmt::format("{}|{}|{}|{}", absolute, kStoreVersion, kImportVersion, kVersion);
  return fmt::format("{}-{:016x}{}", fs::path(model).stem().string(), Checksum(AsBytes(key)),
                     kStoreExtension);
}

/// The record that the preprocessor writes beside a store: the files that the store is made from.
std::string RecordOf(const std::string& store) { return store + ".json"; }

int64_t Nanoseconds(const timespec& time) { return int64_t{time.tv_sec} * 1000000000 + time.tv_nsec; }

/// Whether a file is unchanged since the record was made.
bool IsAsRecorded(const json& input) {
  const auto file = input.find("file"), there = input.find("there");
  if (file == input.end() || !file->is_string() || there == input.end() || !there->is_boolean()) return false;
  struct stat info {};
  if (::stat(file->get_ref<const std::string&>().c_str(), &info) != 0) return !there->get<bool>();
  const auto bytes = input.find("bytes"), changed = input.find("changed_ns");
  return there->get<bool>() && bytes != input.end() && *bytes == static_cast<uint64_t>(info.st_size) &&
         changed != input.end() && *changed == Nanoseconds(info.st_mtim);
}

/// Whether the store exists and all files that it is made from are unchanged.
bool IsCurrent(const std::string& store) {
  std::error_code error;
  if (!fs::exists(store, error) || !fs::exists(RecordOf(store), error)) return false;
  const auto record = ReadJsonFile<json>(RecordOf(store));
  if (!record || !record->is_object()) return false;
  const auto inputs = record->find("inputs");
  return inputs != record->end() && inputs->is_array() && !inputs->empty() &&
         std::ranges::all_of(*inputs,
                             [](const json& input) { return input.is_object() && IsAsRecorded(input); });
}

/// Waits while another process makes this store.
Result<FileLock> AwaitTurn(const std::string& store, const std::string& model, bool quiet) {
  for (bool told = quiet;; told = true) {
    QUARRY_ASSIGN(std::optional<FileLock> lock, FileLock::TryTake(store + ".turn"));
    if (lock) return std::move(*lock);
    if (!told) fmt::print(stderr, "{}: another program is preprocessing it; waiting\n", model);
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
}

Status Make(const std::string& model, const std::string& store, bool quiet) {
  std::error_code error;
  fs::remove(RecordOf(store), error);  // the record describes the previous store
  std::vector<std::string> arguments{
      model, "-o", store, "--stats", RecordOf(store), "--force", "--resume-if-fit"};
  if (quiet) arguments.push_back("--quiet");
  QUARRY_ASSIGN(const int status, RunSibling("quarry-preprocess", arguments));
  // The preprocessor has reported any error itself, except when a signal ended it.
  const bool told = status == 1 || status == 2;
  if (status != 0)
    return tl::unexpected<Error>(
        told ? Error{"", KindOfExit(status)}
             : Error{fmt::format("{}: quarry-preprocess was ended by the system", model)});
  QUARRY_ASSIGN(const uint64_t limit, KeptStoresLimit());
  if (limit == 0) return {};
  // Never removes the store just made, however large it is.
  const uint64_t own = fs::file_size(store, error) + fs::file_size(RecordOf(store), error);
  return ShrinkKeptStores(std::max(limit, own)).map([](auto&&) {});
}

/// The name of the model in a record; empty when the record cannot be read.
std::string ModelOf(const std::string& store) {
  const auto record = ReadJsonFile<json>(RecordOf(store));
  if (!record || !record->is_object()) return "";
  const auto models = record->find("models");
  if (models == record->end() || !models->is_array() || models->empty() || !models->front().is_string())
    return "";
  return models->front().get<std::string>();
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
  return "/tmp/quarry-cache";
}

Result<std::string> StoreFor(const std::string& scene, bool quiet) {
  QUARRY_ASSIGN(const InputFile file, InputFile::Open(scene));
  Bytes start(std::min<uint64_t>(file.size(), kStoreMagic.size()));
  QUARRY_TRY(file.ReadAt(0, start));
  if (AsText(start) == kStoreMagic || fs::path(scene).extension() == kStoreExtension) return scene;

  const std::string folder = CacheFolder();
  std::error_code error;
  QUARRY_TRY(OutputGuard::TakeFolder(folder));
  fs::create_directories(folder, error);
  if (error) return Fail(fmt::format("{}: cannot make this folder: {}", folder, error.message()));
  const std::string store = folder + "/" + KeptName(scene);
  QUARRY_ASSIGN(const FileLock turn, AwaitTurn(store, scene, quiet));
  if (IsCurrent(store)) {
    if (!quiet) fmt::print(stderr, "{}: using the store kept of it, {} (see quarry cache)\n", scene, store);
    ::utimensat(AT_FDCWD, RecordOf(store).c_str(), nullptr, 0);  // the time of last use
    return store;
  }
  TellOnSignal("nothing was rendered");
  QUARRY_TRY(Make(scene, store, quiet));
  TellOnSignal(kKeptOnSignal);
  return store;
}

std::vector<std::string> FilesOfKept(const std::string& store) {
  std::vector<std::string> files;
  const auto record = ReadJsonFile<json>(RecordOf(store));
  if (!record || !record->is_object() || !record->contains("inputs")) return files;
  for (const json& input : (*record)["inputs"])
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
    if (path.ends_with(".work")) path.resize(path.size() - 5);
    if (path.ends_with(kStoreExtension)) stores.push_back(path);
  }
  if (error) return Fail(fmt::format("{}: cannot be listed: {}", folder, error.message()));
  std::ranges::sort(stores);
  stores.erase(std::unique(stores.begin(), stores.end()), stores.end());
  for (const std::string& path : stores) {
    KeptStore store{path, ModelOf(path)};
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
  std::error_code error;
  QUARRY_TRY(OutputGuard::TakeFolder(folder));
  fs::create_directories(folder, error);
  if (error) return Fail(fmt::format("{}: cannot make this folder: {}", folder, error.message()));
  return WriteFileAtomically(folder + "/" + kLimitFile, AsBytes(fmt::format("{}\n", bytes)));
}

}  // namespace quarry

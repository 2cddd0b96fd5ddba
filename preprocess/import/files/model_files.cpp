#include "preprocess/import/files/model_files.h"

#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <mutex>
#include <set>

namespace quarry {
namespace {

std::mutex noted_mutex;
std::map<std::string, ModelFile> noted;
std::set<std::string> own;  // prefixes

int64_t Nanoseconds(const timespec& time) { return int64_t{time.tv_sec} * 1000000000 + time.tv_nsec; }

std::string AbsolutePath(const std::string& path) {
  std::error_code error;
  const std::filesystem::path absolute = std::filesystem::absolute(path, error);
  return error ? std::string() : absolute.lexically_normal().string();
}

/// The file at an absolute path as it is now.
ModelFile Look(const std::string& path) {
  ModelFile file{path};
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) {
    file.there = true;
    file.bytes = static_cast<uint64_t>(info.st_size);
    file.changed_ns = Nanoseconds(info.st_mtim);
    file.status_changed_ns = Nanoseconds(info.st_ctim);
  }
  return file;
}

}  // namespace

void NoteModelFile(const std::string& path) {
  if (path == "-") return;
  const std::string absolute = AbsolutePath(path);
  if (absolute.empty()) return;
  const ModelFile file = Look(absolute);
  const std::lock_guard lock(noted_mutex);
  if (std::ranges::none_of(own, [&](const std::string& prefix) { return absolute.starts_with(prefix); }))
    noted.try_emplace(absolute, file);
}

void DisownModelFiles(const std::string& prefix) {
  const std::lock_guard lock(noted_mutex);
  own.insert(AbsolutePath(prefix));
}

std::vector<ModelFile> ModelFiles() {
  const std::lock_guard lock(noted_mutex);
  std::vector<ModelFile> files;
  for (const auto& [path, file] : noted) files.push_back(file);
  return files;
}

bool RestoreModelFile(const ModelFile& file) {
  const ModelFile now = Look(file.path);
  const std::lock_guard lock(noted_mutex);
  noted.insert_or_assign(file.path, file);
  return now.there == file.there && now.bytes == file.bytes && now.changed_ns == file.changed_ns;
}

}  // namespace quarry

#include "preprocess/import/files/file_identity.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <filesystem>
#include <map>
#include <mutex>

namespace quarry {
namespace {

std::mutex noted_mutex;
std::map<std::string, ModelFile> noted;

int64_t Nanoseconds(const timespec& time) { return int64_t{time.tv_sec} * 1000000000 + time.tv_nsec; }

}  // namespace

std::string FileIdentity(const std::string& path) {
  NoteModelFile(path);
  struct stat info {};
  if (path == "-" || ::stat(path.c_str(), &info) != 0) return path;
  return fmt::format("{} of {} bytes, changed at {}.{:09}", path, info.st_size, info.st_mtim.tv_sec,
                     info.st_mtim.tv_nsec);
}

void NoteModelFile(const std::string& path) {
  if (path == "-") return;
  std::error_code error;
  ModelFile file{std::filesystem::absolute(path, error).lexically_normal().string()};
  if (error) return;
  struct stat info {};
  if (::stat(path.c_str(), &info) == 0) {
    file.there = true;
    file.bytes = static_cast<uint64_t>(info.st_size);
    file.changed_ns = Nanoseconds(info.st_mtim);
    file.status_changed_ns = Nanoseconds(info.st_ctim);
  }
  const std::lock_guard lock(noted_mutex);
  noted.try_emplace(file.path, file);
}

std::vector<ModelFile> ModelFiles() {
  const std::lock_guard lock(noted_mutex);
  std::vector<ModelFile> files;
  for (const auto& [path, file] : noted) files.push_back(file);
  return files;
}

}  // namespace quarry
